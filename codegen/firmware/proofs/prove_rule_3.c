/* Rule 3: a budget of stimuli. What is counted here is what comes out, tick by tick. That the controller counts no
 * less is part of each induction. The operator may send anything. */
#include "controller.h"

enum { ISSUES, VIBRATION, TONES, KINDS };

/* Of LEFT and RIGHT, ticks of these, ticks of FORWARD and RECALL. */
typedef struct {
    int32_t of[KINDS];
} told;

static told any_told(void)
{
    return (told){{int_in(0, MOST), int_in(0, MOST), int_in(0, MOST)}};
}

/* Add a tick. An issue is a direction that did not sound on the tick before. */
static void add(told *t, int32_t before, int32_t command)
{
    t->of[ISSUES] += (directional(command) && (command != before)) ? 1 : 0;
    t->of[VIBRATION] += directional(command) ? 1 : 0;
    t->of[TONES] += ((command == CMEC_COMMAND_FORWARD) || (command == CMEC_COMMAND_RECALL)) ? 1 : 0;
}

static told leg_limit(const cmec *m)
{
    return (told){{m->par.leg_issues, ticks_in(m->par.leg_vibration), ticks_in(m->par.leg_tone)}};
}

static told mission_limit(const cmec *m)
{
    return (told){{m->par.mission_issues, ticks_in(m->par.mission_vibration), ticks_in(m->par.mission_tone)}};
}

static told window_limit(const cmec *m)
{
    return (told){{m->par.window_issues, ticks_in(m->par.window_vibration), ticks_in(m->par.window_tone)}};
}

/* The controller has counted as much, or more, since it noted what was spent. */
static bool counted(const told *t, const int32_t *spent, const int32_t *noted)
{
    bool holds = true;

    for (int i = 0; i < KINDS; i++) {
        holds = holds && (t->of[i] <= (spent[i] - noted[i]));
    }
    return holds;
}

/* What was noted later is not less; and the allowance is no more than the least of the three. */
static bool accounted(const cmec *m)
{
    const told leg = leg_limit(m);
    const told mission = mission_limit(m);
    const told window = window_limit(m);
    bool holds = true;

    for (int i = 0; i < KINDS; i++) {
        holds = holds && (m->state.leg_spent[i] >= 0) && (m->state.leg_spent[i] <= m->state.spent[i]) &&
                (m->state.mission_spent[i] >= 0) && (m->state.mission_spent[i] <= m->state.spent[i]) &&
                (m->state.earlier_spent[i] >= 0) && (m->state.earlier_spent[i] <= m->state.block_spent[i]) &&
                (m->state.block_spent[i] <= m->state.spent[i]) &&
                (m->state.allowance[i] <= (m->state.leg_spent[i] + leg.of[i])) &&
                (m->state.allowance[i] <= (m->state.mission_spent[i] + mission.of[i])) &&
                (m->state.allowance[i] <= (m->state.earlier_spent[i] + window.of[i]));
    }
    return holds;
}

/* A float32 holds what was spent to the one: for seven days of tones. */
static bool exact(const cmec *m)
{
    return (m->state.spent[0] <= 16000000) && (m->state.spent[1] <= 16000000) && (m->state.spent[2] <= 16000000);
}

/* A tick that vibrates, begins to, or calls, is within a limit. */
static bool covered(const told *t, const told *limit, int32_t before, int32_t command)
{
    return directional(command)
               ? ((t->of[VIBRATION] <= limit->of[VIBRATION]) &&
                  ((command == before) || (t->of[ISSUES] <= limit->of[ISSUES])))
               : ((command == CMEC_COMMAND_NONE) || (command == CMEC_COMMAND_STOP) || (t->of[TONES] <= limit->of[TONES]));
}

/* Within a leg and a mission no more is told than they allow. */
void prove_budget(void)
{
    cmec m = any_controller(true);
    const cmec before = m;
    told leg = any_told();
    told mission = any_told();
    const told of_leg = leg_limit(&m);
    const told of_mission = mission_limit(&m);

    __CPROVER_assume(accounted(&m) && exact(&m) && agrees(&m));
    __CPROVER_assume(counted(&leg, m.state.spent, m.state.leg_spent));
    __CPROVER_assume(counted(&mission, m.state.spent, m.state.mission_spent));
    cmec_step(&m);
    if (begins(&before)) {
        mission = (told){{0}};
    }
    if (begins_leg(&before, &m)) {
        leg = (told){{0}};
    }
    add(&leg, before.out.command, m.out.command);
    add(&mission, before.out.command, m.out.command);
    assert(accounted(&m));
    assert(agrees(&m));
    assert(counted(&leg, m.state.spent, m.state.leg_spent));
    assert(counted(&mission, m.state.spent, m.state.mission_spent));
    assert(covered(&leg, &of_leg, before.out.command, m.out.command));
    assert(covered(&mission, &of_mission, before.out.command, m.out.command));
}

/* Since any tick that is no longer ago than the window, no more was told than it allows. */
void prove_window(void)
{
    cmec m = any_controller(true);
    const cmec before = m;
    const told limit = window_limit(&m);
    const int32_t length = ticks_in(m.par.window);
    told since = any_told();
    int32_t spent[KINDS]; /* at that tick */
    int32_t age = int_in(0, length - 1);

    for (int i = 0; i < KINDS; i++) {
        spent[i] = int_in(0, MOST);
        __CPROVER_assume(spent[i] <= m.state.spent[i]);
        __CPROVER_assume((age > m.state.window_ticks) || (spent[i] >= m.state.block_spent[i]));
        __CPROVER_assume((age > (m.state.window_ticks + length)) || (spent[i] >= m.state.earlier_spent[i]));
    }
    __CPROVER_assume(accounted(&m) && exact(&m) && agrees(&m));
    __CPROVER_assume(counted(&since, m.state.spent, spent));
    cmec_step(&m);
    age++;
    add(&since, before.out.command, m.out.command);
    assert(counted(&since, m.state.spent, spent));
    for (int i = 0; i < KINDS; i++) {
        assert(spent[i] <= m.state.spent[i]);
        assert((age > m.state.window_ticks) || (spent[i] >= m.state.block_spent[i]));
        assert((age > (m.state.window_ticks + length)) || (spent[i] >= m.state.earlier_spent[i]));
    }
    assert(covered(&since, &limit, before.out.command, m.out.command));
}

/* A refused cue gives STOP. Until a new trial begins it sounds for `stop_hold` in a mode, and when the operator sends
 * it; whatever else is sent, there is silence. */
void prove_refused(void)
{
    cmec m = any_controller(true);
    const cmec before = m;
    bool closed = nondet_bool();

    __CPROVER_assume(!closed || (m.state.exhausted && !leads(m.state.now) && !m.state.recalling));
    cmec_step(&m);
    closed = (closed && !begins(&before)) || (m.out.anomaly == CMEC_ANOMALY_BUDGET_SPENT);
    assert((m.out.anomaly != CMEC_ANOMALY_BUDGET_SPENT) || (m.out.command == CMEC_COMMAND_STOP));
    assert(!closed || (m.state.exhausted && !leads(m.state.now) && !m.state.recalling));
    assert(!closed || (m.out.command == CMEC_COMMAND_NONE) ||
           ((m.out.command == CMEC_COMMAND_STOP) &&
            ((m.in.override == CMEC_COMMAND_STOP) || (m.state.ticks <= ticks_over(m.par.stop_hold)))));
}

/* Ticks for which a command sounds, at most. */
static int32_t longest(const cmec *m)
{
    const int32_t stop = leads(m->out.mode) ? ticks_in(m->par.longest_stop) : ticks_over(m->par.stop_hold);

    return directional(m->out.command)                  ? ticks_in(m->par.longest_vibration)
           : (m->out.command == CMEC_COMMAND_STOP) ? stop
                                                        : ticks_in(m->par.longest_tone);
}

/* No command sounds longer than it may. A STOP begins anew where it ends a trial or answers a refused cue. */
void prove_longest(void)
{
    cmec m = any_controller(true);
    const int32_t before = m.out.command;
    int32_t run = int_in(1, MOST);

    __CPROVER_assume(agrees(&m) && ((before == CMEC_COMMAND_NONE) || (run <= (m.state.cue_ticks + 1))));
    cmec_step(&m);
    run = ((m.out.command == before) && (m.state.breach == CMEC_ANOMALY_NONE)) ? (run + 1) : 1;
    assert(agrees(&m) && ((m.out.command == CMEC_COMMAND_NONE) || (run <= (m.state.cue_ticks + 1))));
    assert((m.out.command == CMEC_COMMAND_NONE) || (run <= longest(&m)));
}

/* The induction begins where the program does. */
void prove_start(void)
{
    const cmec m = started();

    assert(accounted(&m) && exact(&m) && agrees(&m));
    assert((m.state.spent[ISSUES] == 0) && (m.state.spent[VIBRATION] == 0) && (m.state.spent[TONES] == 0));
    assert(m.out.command == CMEC_COMMAND_NONE);
}
