/* Rule 1: the order of precedence. */
#include "controller.h"

/* STOP sounds, or has sounded as long as it may. */
static bool stops(const cmec *before, const cmec *m)
{
    const int32_t hold = ticks_over(m->par.stop_hold) - 1; /* and this tick */
    const bool silent = m->par.guarded && (m->out.command == CMEC_COMMAND_NONE) &&
                        (((before->state.cue == CMEC_COMMAND_STOP) && (before->state.cue_ticks >= hold)) ||
                         (!leads(m->out.mode) && (before->state.ticks > hold)));

    return (m->out.command == CMEC_COMMAND_STOP) || silent;
}

/* A lost link, the operator, bad input, an invalid estimate, in this order. */
void prove_precedence(void)
{
    cmec m = any_controller(nondet_bool());
    const cmec before = m;

    __CPROVER_assume(agrees(&m) || !m.par.guarded);
    cmec_step(&m);
    if (!m.in.link_ok) {
        assert(stops(&before, &m));
    } else if (overridden(&m)) {
        const bool spent = m.par.guarded && m.state.exhausted && stops(&before, &m);
        const bool silent = m.par.guarded && (m.out.command == CMEC_COMMAND_NONE) && (before.state.cue == m.in.override);

        assert((m.out.command == m.in.override) || spent || silent || ((m.state.breach != CMEC_ANOMALY_NONE) && (m.out.command == CMEC_COMMAND_STOP)));
    } else if (bad(&m) || !m.in.valid) {
        assert(stops(&before, &m));
    }
}

/* A mode's own command, without an operator, bad input or a lost link (Figure 4.2). */
static int32_t own(int32_t mode)
{
    static const int32_t commands[12] = {0, 1, 2, 4, 5, 0, 2, 3, 3, 0, 0, 2};

    return commands[mode];
}

/* Where nothing beats the table, the mode's command is given, or the silence and the STOP that the limits make of it. */
void prove_mode(void)
{
    cmec m = any_controller(nondet_bool());

    cmec_step(&m);
    if (m.in.link_ok && m.in.valid && !bad(&m) && (m.in.override == CMEC_COMMAND_NONE)) {
        const bool silent = (m.out.command == CMEC_COMMAND_NONE) && (!leads(m.out.mode) || (m.state.cue_ticks > 0));
        const bool stopped = (m.out.command == CMEC_COMMAND_STOP) && (m.state.exhausted || !leads(m.out.mode));

        assert((m.out.command == own(m.out.mode)) || (m.par.guarded && (silent || stopped)));
    }
    assert((m.out.status == CMEC_STATUS_FAILED) == ((m.out.mode == CMEC_MODE_FAILED) || (m.out.mode == CMEC_MODE_FAILURE_RECALL)));
    assert((m.out.status == CMEC_STATUS_SUCCESS) == (m.out.mode == CMEC_MODE_SUCCESS));
    assert((m.out.status == CMEC_STATUS_STOPPED) == (m.out.mode == CMEC_MODE_STOPPED));
    assert((m.out.status == CMEC_STATUS_IDLE) == (m.out.mode == CMEC_MODE_IDLE));
    assert(within(m.out.status, CMEC_STATUS_IDLE, CMEC_STATUS_STOPPED));
}
