/* The controller from any state: inputs of any bits, NaN and infinity included. */
#include "cmec.c"

#include "proof.h"

float sqrtf(float x)
{
    const float root = nondet_float();

    assert(x >= 0.0F);
    __CPROVER_assume((root >= 0.0F) && (root <= 1.0e6F));
    return root;
}

/* Is there a waypoint left? */
static bool on_a_leg(const cmec *m)
{
    return (m->state.now > CMEC_MODE_IDLE) && (m->state.now <= CMEC_MODE_STOP_AT_WAYPOINT);
}

static cmec any_cmec(void)
{
    cmec m; /* any state */

    m.state.now = short_in(CMEC_MODE_IDLE, CMEC_MODE_STOPPED);
    m.state.ticks = short_in(0, 30000);
    m.state.overruled = short_in(CMEC_ANOMALY_NONE, CMEC_ANOMALY_BAD_INPUT);
    m.state.reached = short_in(0, 16);
    m.state.turns = short_in(0, 1000);
    m.state.issued = int_in(0, 2000000000);
    m.state.count = short_in(1, 16);
    m.state.planned = short_in(CMEC_COMMAND_NONE, CMEC_COMMAND_RIGHT);
    m.state.target_north = float_in(-1.0e5F, 1.0e5F);
    m.state.target_east = float_in(-1.0e5F, 1.0e5F);
    m.state.issue_north = float_in(-1.0e5F, 1.0e5F);
    m.state.issue_east = float_in(-1.0e5F, 1.0e5F);
    m.state.base_north = float_in(-1.0e5F, 1.0e5F);
    m.state.base_east = float_in(-1.0e5F, 1.0e5F);
    m.mission.home_north = float_in(-1.0e5F, 1.0e5F);
    m.mission.home_east = float_in(-1.0e5F, 1.0e5F);
    m.mission.waypoint_count = short_in(1, 16);
    for (int i = 0; i < 16; i++) {
        m.state.route_north[i] = float_in(-1.0e5F, 1.0e5F);
        m.state.route_east[i] = float_in(-1.0e5F, 1.0e5F);
        m.mission.waypoint_north[i] = float_in(-1.0e5F, 1.0e5F);
        m.mission.waypoint_east[i] = float_in(-1.0e5F, 1.0e5F);
    }
    for (int i = 0; i < 13; i++) {
        m.state.anomalies[i] = int_in(0, 2000000000);
    }
    for (int i = 0; i < 3; i++) {
        m.state.spent[i] = int_in(0, 2000000000);
        m.state.leg_spent[i] = int_in(0, 2000000000);
        m.state.mission_spent[i] = int_in(0, 2000000000);
        m.state.block_spent[i] = int_in(0, 2000000000);
        m.state.earlier_spent[i] = int_in(0, 2000000000);
    }
    m.par.leg_issues = short_in(0, 30000);
    m.par.mission_issues = short_in(0, 30000);
    m.par.window_issues = short_in(0, 30000);
    m.state.survey_ticks = short_in(0, 4);
    m.state.edge = short_in(0, 7);
    m.state.leg_ticks = short_in(0, 30000);
    m.state.surveys = short_in(0, 30000);
    m.state.still_ticks = short_in(0, 30000);
    m.state.cue_ticks = short_in(0, 30000);
    m.state.window_ticks = short_in(0, 30000);
    m.in.valid = nondet_bool();
    m.in.start = nondet_bool();
    m.in.link_ok = nondet_bool();
    m.state.uncounted = nondet_bool();
    m.par.limit_stop_deviation = nondet_bool();
    m.par.count_reissue = nondet_bool();
    m.par.reset_turns = nondet_bool();
    m.par.stop_hold = float_in(0.0F, 1.0e3F);
    m.par.forward_timeout = float_in(0.04F, 1.0e3F);
    m.par.forward_distance = float_in(0.0F, 1.0e4F);
    m.par.dead_time = float_in(0.0F, 1.0e3F);
    m.par.turn_timeout = float_in(0.0F, 1.0e3F);
    m.par.max_turns = short_in(0, 1000);
    m.state.early = nondet_bool();
    m.state.timed = nondet_bool();
    m.state.ran = short_in(0, 30000);
    m.state.settling = short_in(0, 300);
    m.state.noted_tick = short_in(0, 30000);
    m.par.response_time = float_in(0.0F, 10.0F);
    m.par.response_sd = float_in(0.0F, 10.0F);
    __CPROVER_assume(on_a_leg(&m) ? (m.state.reached < m.state.count) : (m.state.reached <= m.state.count));
    return m;
}

static bool bad(const cmec *m)
{
    return !(fabsf(m->in.north) <= 1.0e5F) || !(fabsf(m->in.east) <= 1.0e5F) || !(fabsf(m->in.speed) <= 50.0F) ||
           !(fabsf(m->in.heading) <= 7.0F) || (m->in.override < 0) || (m->in.override > 5);
}

/* Distance and deviation are finite whatever the inputs are. */
void prove_aim(void)
{
    cmec m = any_cmec();

    cmec_aim(&m);
    assert((m.out.distance >= 0.0F) && (m.out.distance <= 1.0e6F));
    assert((m.out.deviation >= -3.2F) && (m.out.deviation <= 3.2F));
}

/* The order of precedence holds on every tick: a lost link, the operator, bad input, an invalid estimate. */
void prove_precedence(void)
{
    cmec m = any_cmec();

    cmec_watch(&m);
    cmec_answer(&m);
    assert((m.out.command >= CMEC_COMMAND_NONE) && (m.out.command <= CMEC_COMMAND_RIGHT));
    assert((m.out.status >= CMEC_STATUS_IDLE) && (m.out.status <= CMEC_STATUS_STOPPED));
    if (!m.in.link_ok) {
        assert(m.out.command == CMEC_COMMAND_STOP);
    } else if ((m.in.override > 0) && (m.in.override <= 5)) {
        assert(m.out.command == m.in.override);
    } else if (bad(&m) || !m.in.valid) {
        assert(m.out.command == CMEC_COMMAND_STOP);
    } else {
        assert(m.state.overruled == CMEC_ANOMALY_NONE);
    }
}

/* Is it the command, or what the limits make of it: STOP, or silence? */
static bool gives(const cmec *m, int16_t command)
{
    const int16_t given = m->out.command;

    return (given == command) ||
           (m->par.guarded && ((given == CMEC_COMMAND_STOP) || (given == CMEC_COMMAND_NONE)));
}

/* The whole tick: modes, counts within their declared ranges, memory; the order of precedence again. */
void prove_step(void)
{
    cmec m = any_cmec();

    m.par.guarded = nondet_bool();
    if (!m.par.guarded) { /* then nothing ever sets them */
        m.state.led = m.state.fresh = m.state.turned = m.state.over = m.state.surveyed = m.state.recalling = false;
        m.state.breach = CMEC_ANOMALY_NONE;
        m.state.edge = 0;
    }
    cmec_step(&m);
    assert((m.state.ticks >= 0) && (m.state.ticks <= 30000));
    assert((m.state.turns >= 0) && (m.state.turns <= 1000));
    assert((m.state.count >= 1) && (m.state.count <= 16));
    assert(m.state.reached >= 0);
    assert(on_a_leg(&m) ? (m.state.reached < m.state.count) : (m.state.reached <= m.state.count));
    assert((m.state.now >= CMEC_MODE_IDLE) && (m.state.now <= CMEC_MODE_STOPPED));
    assert((m.out.command >= CMEC_COMMAND_NONE) && (m.out.command <= CMEC_COMMAND_RIGHT));
    if (!m.in.link_ok) {
        assert(gives(&m, CMEC_COMMAND_STOP));
    } else if ((m.in.override > 0) && (m.in.override <= 5)) {
        assert(gives(&m, m.in.override));
    } else if (bad(&m) || !m.in.valid) {
        assert(gives(&m, CMEC_COMMAND_STOP));
    }
}
