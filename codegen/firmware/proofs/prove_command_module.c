/* Every number as a command: the cue of one of six commands is played, and no other. */
#include "command_module.c"

#include "proof.h"
#include "shipped.h"

void prove_step(void)
{
    command_module m;

    command_module_defaults(&m);
    m.par = shipped().command_module.par;
    m.in.command = nondet_i16();
    command_module_step(&m);
    switch (m.in.command) { /* Table 4.1 */
    case COMMAND_MODULE_COMMAND_FORWARD:
        assert(m.out.tone_hz == 1500.0F);
        break;
    case COMMAND_MODULE_COMMAND_STOP:
        assert(m.out.tone_hz == 3500.0F);
        break;
    case COMMAND_MODULE_COMMAND_RECALL:
        assert(m.out.tone_hz == 9500.0F);
        break;
    default:
        assert(m.out.tone_hz == 0.0F);
        break;
    }
    assert(m.out.vibrate_left == (m.in.command == COMMAND_MODULE_COMMAND_LEFT));
    assert(m.out.vibrate_right == (m.in.command == COMMAND_MODULE_COMMAND_RIGHT));
}
