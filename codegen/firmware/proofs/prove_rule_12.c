/* Rule 12: nobody leads: silence. */
#include "controller.h"

/* With nobody leading, and no operator, STOP sounds for `stop_hold` since the mode began, then nothing. */
static bool told_nobody(const cmec *m, int32_t alone)
{
    const int32_t hold = ticks_over(m->par.stop_hold);
    const bool stops = (m->state.cue == CMEC_COMMAND_STOP) && (alone <= (m->state.cue_ticks + 1));
    const bool silent = (m->state.cue == CMEC_COMMAND_NONE) && (m->state.ticks > hold);

    return (alone == 0) || (m->out.mode != m->state.now) || (((alone <= (m->state.ticks + 1)) || (m->state.ticks > hold)) && (stops || silent));
}

void prove_silence(void)
{
    cmec m = any_controller(true);
    const int32_t before = m.state.now;
    int32_t alone = int_in(0, MOST); /* ticks for which nobody has led, in this mode */

    __CPROVER_assume(told_nobody(&m, alone));
    cmec_step(&m);
    if (leads(m.out.mode) || overridden(&m)) {
        alone = 0;
    } else {
        alone = ((m.out.mode == before) && (m.state.breach == CMEC_ANOMALY_NONE)) ? (alone + 1) : 1;
    }
    assert(told_nobody(&m, alone));
    assert((alone == 0) || (m.out.command == CMEC_COMMAND_NONE) || (m.out.command == CMEC_COMMAND_STOP));
    assert((alone <= ticks_over(m.par.stop_hold)) || (m.out.command == CMEC_COMMAND_NONE));
}

void prove_start(void)
{
    const cmec m = started();

    assert(!leads(m.out.mode) && told_nobody(&m, 0));
}
