/* Rule 4: getting on. */
#include "controller.h"

/* May the animal be led, though a limit ended the trial? Only home, from outside the fence, where that is wanted. */
static bool recalled(const cmec *m, bool ended, bool fenced)
{
    const bool homewards = m->par.fence_recall && fenced && (m->state.now == CMEC_MODE_FAILURE_RECALL);

    return (!ended || !leads(m->state.now) || homewards) &&
           (!m->state.recalling || (m->par.fence_recall && (!ended || fenced)));
}

/* A limit that is broken (rules 3, 4, 7) ends the trial in STOP; only a start, or the recall, leads again. */
void prove_breach(void)
{
    cmec m = any_controller(true);
    const cmec before = m;
    bool ended = nondet_bool();
    bool fenced = nondet_bool();

    m.par.fence_recall = nondet_bool();
    __CPROVER_assume(recalled(&m, ended, fenced));
    cmec_step(&m);
    if (begins(&before)) {
        ended = false;
        fenced = false;
    }
    if (m.out.anomaly >= CMEC_ANOMALY_BUDGET_SPENT) {
        ended = true;
        fenced = fenced || (m.out.anomaly == CMEC_ANOMALY_OUTSIDE_FENCE);
        assert((m.out.command == CMEC_COMMAND_STOP) && !leads(m.out.mode));
        assert(!leads(before.state.now) || !m.in.start ||
               ((m.out.mode == CMEC_MODE_STOPPED) && (m.out.status == CMEC_STATUS_STOPPED)));
    }
    assert(recalled(&m, ended, fenced));
    assert(!ended || overridden(&m) || (m.out.command == CMEC_COMMAND_NONE) ||
           (m.out.command == CMEC_COMMAND_STOP) || (fenced && (m.out.command == CMEC_COMMAND_RECALL)));
}

/* The controller's count, every five ticks, of these ticks under way. */
static bool timed(const cmec *m, int32_t mission, int32_t leg)
{
    return !leads(m->state.now) || ((mission <= ((5 * m->state.surveys) + m->state.survey_ticks)) &&
                                    ((5 * m->state.surveys) < ticks_over(m->par.mission_time)) &&
                                    (leg <= (m->state.leg_ticks + m->state.survey_ticks)) &&
                                    (m->state.leg_ticks < ticks_over(m->par.leg_time)));
}

/* No mission and no leg lasts longer than it may, by more than 0.2 s, whatever happens. */
void prove_times(void)
{
    cmec m = any_controller(true);
    const cmec before = m;
    int32_t mission = int_in(0, MOST); /* ticks under way */
    int32_t leg = int_in(0, MOST);

    __CPROVER_assume(timed(&m, mission, leg) && !m.state.recalling && (m.par.leg_time == m.par.recall_time));
    cmec_step(&m);
    if (begins(&before)) {
        mission = 0;
    }
    if (begins_leg(&before, &m)) {
        leg = 0;
    }
    mission++;
    leg++;
    assert(timed(&m, mission, leg) && !m.state.recalling);
    assert(!leads(m.out.mode) ||
           ((mission < (ticks_over(m.par.mission_time) + 5)) && (leg < (ticks_over(m.par.leg_time) + 5))));
}

/* Under FORWARD or RECALL, also once it is silent; not where the table may not decide, or a spent budget stops. */
static bool led_on(const cmec *m)
{
    const int32_t mode = m->out.mode;
    const bool onward =
        (mode == CMEC_MODE_FORWARD) || (mode == CMEC_MODE_RECALL) || (mode == CMEC_MODE_FAILURE_RECALL);

    return onward && m->in.link_ok && m->in.valid && !bad(m) && (m->in.override == CMEC_COMMAND_NONE) &&
           !m->state.exhausted;
}

static bool lingers(const cmec *m, int32_t still)
{
    return (still <= (m->state.still_ticks + m->state.survey_ticks)) && !m->state.recalling &&
           (!leads(m->state.now) || (m->state.still_ticks < ticks_over(m->par.progress_time)));
}

/* An animal that stays where it is is not told to go on for longer than `progress_time`, by more than 0.2 s. */
void prove_still(void)
{
    cmec m = any_controller(true);
    const cmec before = m;
    int32_t still = int_in(0, MOST); /* ticks of the trial's FORWARD or RECALL, at this place */

    __CPROVER_assume((m.in.north == m.state.moved_north) && (m.in.east == m.state.moved_east));
    __CPROVER_assume(lingers(&m, still));
    cmec_step(&m);
    still = begins_leg(&before, &m) ? 0 : still;
    still = led_on(&m) ? (still + 1) : 0;
    assert(lingers(&m, still));
    assert(still < (ticks_over(m.par.progress_time) + 5));
}

/* At a survey, an animal that came farther from its target than it was on this leg is stopped. */
void prove_departing(void)
{
    cmec m = any_controller(true);
    const cmec before = m;
    float least = float_in(0.0F, 1.0e6F); /* distance from the target at the surveys of this leg */

    __CPROVER_assume(m.state.closest <= least);
    cmec_step(&m);
    if (begins_leg(&before, &m)) {
        least = 1.0e6F;
    }
    if (m.state.surveyed && m.in.valid && !bad(&m)) {
        assert(!leads(m.out.mode) || (m.out.distance <= (least + (1.001F * m.par.departing_distance))));
        least = (m.out.distance < least) ? m.out.distance : least;
    }
    assert(m.state.closest <= least);
}

/* A trial under way is surveyed every five ticks. */
void prove_survey(void)
{
    cmec m = any_controller(true);
    int32_t waited = int_in(0, MOST);

    __CPROVER_assume(waited <= m.state.survey_ticks);
    cmec_step(&m);
    waited = (!leads(m.out.mode) || m.state.surveyed) ? 0 : (waited + 1);
    assert((waited <= m.state.survey_ticks) && (waited < 5));
}

/* The inductions begin where the program does. */
void prove_start(void)
{
    const cmec m = started();

    assert(recalled(&m, false, false) && timed(&m, 0, 0) && lingers(&m, 0) && (m.state.closest <= 1.0e6F));
}
