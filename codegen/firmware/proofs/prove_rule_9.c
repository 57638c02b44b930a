/* Rule 9: nothing resumes. */
#include "controller.h"

/* A lost link ends a trial in STOP, where `resume` is not set. */
void prove_link(void)
{
    cmec m = any_controller(true);
    const bool led = leads(m.state.now);

    m.in.link_ok = false;
    cmec_step(&m);
    assert(!leads(m.out.mode));
    assert((m.out.command == CMEC_COMMAND_STOP) || (m.out.command == CMEC_COMMAND_NONE));
    if (led && m.in.start) {
        assert((m.out.mode == CMEC_MODE_STOPPED) && (m.out.command == CMEC_COMMAND_STOP));
        assert((m.out.status == CMEC_STATUS_STOPPED) && (m.out.anomaly != CMEC_ANOMALY_NONE));
    }
}

/* Only a start in IDLE begins a trial, or the recall from outside the fence where that is wanted. */
void prove_begin(void)
{
    cmec m = any_controller(nondet_bool());
    const cmec before = m;

    m.par.fence_recall = nondet_bool();
    __CPROVER_assume(m.par.fence_recall || !m.state.recalling);
    cmec_step(&m);
    assert(m.par.fence_recall || !m.state.recalling);
    if (leads(m.state.now) && !leads(before.state.now)) {
        assert(begins(&before) || (m.par.fence_recall && (before.state.now == CMEC_MODE_STOPPED) &&
                                   (m.state.now == CMEC_MODE_FAILURE_RECALL)));
    }
}

/* After power-up nothing leads, and no budget of an earlier trial is left. */
void prove_start(void)
{
    const cmec m = started();

    assert(!leads(m.state.now) && !m.state.recalling && (m.out.command == CMEC_COMMAND_NONE));
}
