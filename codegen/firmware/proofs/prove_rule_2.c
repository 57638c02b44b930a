/* Rule 2: directions to an animal at rest alone, how long and how often; none after a failure. */
#include "controller.h"

/* LEFT never follows RIGHT directly, nor RIGHT LEFT, unless the operator commands it. */
void prove_switch(void)
{
    cmec m = any_controller(true);
    const int32_t before = m.out.command;

    __CPROVER_assume(agrees(&m));
    cmec_step(&m);
    assert(agrees(&m));
    assert(!directional(before) || !directional(m.out.command) || (before == m.out.command) || overridden(&m));
}

/* How many ticks the animal has been told nothing but STOP, nothing at all, and a direction of the controller's. */
typedef struct {
    int32_t stop;
    int32_t silence;
    int32_t turn;
} spell;

/* The controller's count of ticks is no more than these; that of a turn is no less. */
static bool lasted(const cmec *m, const spell *s)
{
    const bool turns = (m->state.now == CMEC_MODE_LEFT) || (m->state.now == CMEC_MODE_RIGHT);

    return (!halting(m->state.now) || (m->state.ticks <= s->stop)) &&
           ((m->state.now != CMEC_MODE_DEAD) || (m->state.ticks < s->silence)) &&
           (!turns || (s->turn <= (m->state.ticks + 1)));
}

/* A direction begins at an animal at rest behind a STOP that was held, or behind a no-command period. It ends in time. */
void prove_rest(void)
{
    cmec m = any_controller(true);
    const int32_t before = m.out.command;
    const spell earlier = {int_in(0, MOST), int_in(0, MOST), int_in(0, MOST)};
    spell s = {0, 0, 0};

    __CPROVER_assume(agrees(&m) && lasted(&m, &earlier));
    cmec_step(&m);
    if (directional(m.out.command) && (m.out.command != before) && !overridden(&m)) {
        const bool held = earlier.stop >= (ticks_over(m.par.stop_hold) - 1); /* and this tick */

        assert((earlier.silence >= ticks_over(m.par.dead_time)) ||
               (held && (fabsf(m.in.speed) < m.par.stopped_speed) && (m.in.speed_sd <= m.par.rest_speed_sd)));
    }
    if (m.state.cue == CMEC_COMMAND_STOP) {
        s.stop = earlier.stop + 1;
    }
    if (m.out.command == CMEC_COMMAND_NONE) {
        s.silence = earlier.silence + 1;
    }
    if (directional(m.out.command) && !overridden(&m)) {
        s.turn = (m.out.command == before) ? (earlier.turn + 1) : 1;
    }
    assert(agrees(&m) && lasted(&m, &s));
    assert(s.turn <= ticks_over(m.par.turn_timeout));
}

/* No more turns than MAXTURN are begun, from waypoint to waypoint or in a trial, for any MAXTURN. A turn that is told
 * again behind its TURN FAILURE counts where `count_reissue` is set. */
void prove_turns(void)
{
    cmec m = any_controller(nondet_bool());
    const cmec before = m;
    int32_t begun = int_in(0, MOST);
    int32_t failed = int_in(CMEC_COMMAND_NONE, CMEC_COMMAND_RIGHT); /* direction that TURN FAILURE ended */
    bool again;

    m.par.max_turns = int_in(0, 1000);
    m.par.count_reissue = nondet_bool();
    m.par.reset_turns = nondet_bool();
    __CPROVER_assume((begun <= m.state.turns) && (m.state.turns <= m.par.max_turns));
    __CPROVER_assume((m.state.now != CMEC_MODE_DEAD) || !m.state.uncounted || !directional(m.state.planned) ||
                     ((m.state.planned == failed) && !m.par.count_reissue));
    cmec_step(&m);
    again = (m.out.mode == ((failed == CMEC_COMMAND_LEFT) ? CMEC_MODE_LEFT : CMEC_MODE_RIGHT)) &&
            directional(failed) && !m.par.count_reissue;
    if (begins(&before) || (m.par.reset_turns && (m.out.waypoint != before.state.reached))) {
        begun = 0;
    }
    if (((m.out.mode == CMEC_MODE_LEFT) || (m.out.mode == CMEC_MODE_RIGHT)) && (m.out.mode != before.state.now) &&
        !again) {
        begun++;
    }
    if (m.out.mode != CMEC_MODE_DEAD) {
        failed = CMEC_COMMAND_NONE;
    } else if (m.out.anomaly == CMEC_ANOMALY_TURN_FAILURE) {
        failed = (before.state.now == CMEC_MODE_LEFT) ? CMEC_COMMAND_LEFT : CMEC_COMMAND_RIGHT;
    } else {
        /* as it was */
    }
    assert((begun <= m.state.turns) && (m.state.turns <= m.par.max_turns));
    assert((m.state.now != CMEC_MODE_DEAD) || !m.state.uncounted || !directional(m.state.planned) ||
           ((m.state.planned == failed) && !m.par.count_reissue));
}

/* Once a trial has failed, the controller tells nothing but RECALL and STOP until a new one begins. */
void prove_failed(void)
{
    cmec m = any_controller(true);
    const cmec before = m;
    bool failed = nondet_bool();

    __CPROVER_assume(!failed || !going(m.state.now));
    cmec_step(&m);
    failed = (failed && !begins(&before)) || (m.out.anomaly == CMEC_ANOMALY_TRIAL_FAILURE) ||
             (m.out.status == CMEC_STATUS_FAILED);
    assert(!failed || !going(m.state.now));
    assert(!failed || overridden(&m) || (m.out.command == CMEC_COMMAND_RECALL) ||
           (m.out.command == CMEC_COMMAND_STOP) || (m.out.command == CMEC_COMMAND_NONE));
}

/* A start that is withdrawn ends the trial. */
void prove_end(void)
{
    cmec m = any_controller(nondet_bool());

    m.in.start = false;
    cmec_step(&m);
    assert((m.state.now == CMEC_MODE_IDLE) || (m.state.now == CMEC_MODE_STOPPED));
    assert(overridden(&m) || (m.out.command == CMEC_COMMAND_STOP) || (m.out.command == CMEC_COMMAND_NONE));
}

/* The inductions begin where the program does. */
void prove_start(void)
{
    const cmec m = started();
    const spell s = {0, 0, 0};

    assert(agrees(&m) && lasted(&m, &s) && (m.state.turns == 0) && (m.state.now == CMEC_MODE_IDLE));
}
