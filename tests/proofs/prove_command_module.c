/* Every number as a command: one of six commands is played. */
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
    assert((m.out.tone_hz == 0.0F) || (m.out.tone_hz == 1500.0F) || (m.out.tone_hz == 3500.0F) ||
           (m.out.tone_hz == 9500.0F));
    assert(!(m.out.vibrate_left && m.out.vibrate_right));
    assert((m.out.tone_hz == 0.0F) || (!m.out.vibrate_left && !m.out.vibrate_right));
    assert((m.in.command != COMMAND_MODULE_COMMAND_STOP) || (m.out.tone_hz == 3500.0F));
}
