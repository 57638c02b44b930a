/* controller: the controller that ships, in any state that it can come to, for proofs by induction
 *
 * A proof assumes of a state what was shown of the one before, makes one tick with inputs of any bits, and shows it
 * again, beside its rule; `prove_start` shows it of the program's start. So both hold for ever. What all proofs
 * assume, `possible`, is shown in prove_controller.c. */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include <math.h>

/* The call of cmec_aim gives any distance and deviation within the ranges that prove_aim (prove_cmec.c) shows, that
 * of cmec_cross any answer, those of what aims off any drift, response time, offset, lead and braking point. The
 * pasted name tells the call, whose argument is `m`, from the definition, whose argument is `cmec *m`. */
#define cmec_aim(argument) AIM_OF_##argument)
#define AIM_OF_cmec shipped_aim(cmec
#define AIM_OF_m any_aim(m
#define cmec_cross(argument) CROSS_OF_##argument)
#define CROSS_OF_cmec shipped_cross(cmec
#define CROSS_OF_m any_cross(m
#define cmec_learn_drift(argument) DRIFT_OF_##argument)
#define DRIFT_OF_cmec shipped_learn_drift(cmec
#define DRIFT_OF_m any_allowance(m
#define cmec_learn_response(argument) RESPONSE_OF_##argument)
#define RESPONSE_OF_cmec shipped_learn_response(cmec
#define RESPONSE_OF_m any_allowance(m
#define cmec_aim_off(argument) OFFSET_OF_##argument)
#define OFFSET_OF_cmec shipped_aim_off(cmec
#define OFFSET_OF_m any_allowance(m
#define cmec_lead_turn(argument) LEAD_OF_##argument)
#define LEAD_OF_cmec shipped_lead_turn(cmec
#define LEAD_OF_m any_allowance(m
#define cmec_brake(argument) BRAKE_OF_##argument)
#define BRAKE_OF_cmec shipped_brake(cmec
#define BRAKE_OF_m any_allowance(m
#include "cmec.h"
static void any_allowance(cmec *m);
static void any_aim(cmec *m);
static void any_cross(cmec *m);
#include "cmec.c"
#undef cmec_aim
#undef cmec_cross
#undef cmec_learn_drift
#undef cmec_learn_response
#undef cmec_aim_off
#undef cmec_lead_turn
#undef cmec_brake

#include "proof.h"
#include "shipped.h"

#define MOST 2000000000 /* of a counter: two and a half years of ticks */

float sqrtf(float x)
{
    const float root = nondet_float();

    assert(x >= 0.0F);
    __CPROVER_assume((root >= 0.0F) && (root <= 1.0e6F));
    return root;
}

static void any_aim(cmec *m)
{
    m->out.distance = float_in(0.0F, 1.0e6F);
    m->out.deviation = float_in(-3.2F, 3.2F);
}

static void any_allowance(cmec *m)
{
    m->state.learnt_drift = nondet_float();
    m->state.drift_variance = nondet_float();
    m->state.learnt_response = nondet_float();
    m->state.response_variance = nondet_float();
    m->state.settling = short_in(0, 300);
    m->state.noted_heading = nondet_float();
    m->state.noted_tick = short_in(0, 30000);
    m->state.timed = nondet_bool();
    m->state.ran = short_in(0, 30000);
    m->state.offset = nondet_float();
    m->state.lead = nondet_float();
    m->state.early = nondet_bool();
}

static void any_cross(cmec *m)
{
    m->state.inside = nondet_bool();
    m->state.beside = false;
}

/* Ticks that a time holds, and after which it is over: a tenth of a tick does not count. */
static int32_t ticks_in(float seconds)
{
    return (int32_t)((25.0 * (double)seconds) + 0.1);
}

static int32_t ticks_over(float seconds)
{
    return (int32_t)((25.0 * (double)seconds) + 0.9);
}

static bool within(int32_t value, int32_t low, int32_t high)
{
    return (value >= low) && (value <= high);
}

static bool near(float coordinate)
{
    return fabsf(coordinate) <= 1.0e5F;
}

/* Is a trial under way in a mode? */
static bool leads(int32_t mode)
{
    return (mode >= CMEC_MODE_FORWARD) && (mode <= CMEC_MODE_FAILURE_RECALL);
}

/* Is a trial under way, and not yet a recall? */
static bool going(int32_t mode)
{
    return (mode >= CMEC_MODE_FORWARD) && (mode <= CMEC_MODE_STOP_AT_WAYPOINT);
}

static bool halting(int32_t mode)
{
    return (mode == CMEC_MODE_STOP_TO_TURN) || (mode == CMEC_MODE_STOP_AT_WAYPOINT);
}

static bool directional(int32_t command)
{
    return (command == CMEC_COMMAND_LEFT) || (command == CMEC_COMMAND_RIGHT);
}

/* Does the operator's command hold on this tick? */
static bool overridden(const cmec *m)
{
    return m->in.link_ok && (m->in.override > CMEC_COMMAND_NONE) && (m->in.override <= CMEC_COMMAND_RIGHT);
}

/* With the limits on, while a trial is under way and was not interrupted on this tick, the cue is the mode's. */
static bool agrees(const cmec *m)
{
    return (!going(m->state.now) || !m->state.exhausted) &&
           ((m->state.now != CMEC_MODE_LEFT) || (m->state.cue == CMEC_COMMAND_LEFT)) &&
           ((m->state.now != CMEC_MODE_RIGHT) || (m->state.cue == CMEC_COMMAND_RIGHT)) &&
           ((m->state.now != CMEC_MODE_DEAD) || (m->state.cue == CMEC_COMMAND_NONE)) &&
           (!halting(m->state.now) || (m->state.cue == CMEC_COMMAND_STOP) || (m->state.ticks == 0)) &&
           ((m->out.command == m->state.cue) ||
            ((m->out.command == CMEC_COMMAND_NONE) && (!directional(m->state.cue) || (m->state.cue_ticks >= ticks_in(m->par.longest_vibration)))));
}

/* Is an input out of its range, or not a number? */
static bool bad(const cmec *m)
{
    return !near(m->in.north) || !near(m->in.east) || !(fabsf(m->in.speed) <= 50.0F) ||
           !(fabsf(m->in.heading) <= 7.0F) || !within(m->in.override, CMEC_COMMAND_NONE, CMEC_COMMAND_RIGHT);
}

/* Does a tick from this state, with these inputs, begin a trial? */
static bool begins(const cmec *m)
{
    return (m->state.now == CMEC_MODE_IDLE) && m->in.start && m->in.link_ok && m->in.valid && !bad(m) &&
           (m->in.override == CMEC_COMMAND_NONE);
}

/* Has a tick begun a leg: a trial, or a way to another target? */
static bool begins_leg(const cmec *before, const cmec *after)
{
    return begins(before) || (before->state.towards_north != after->state.towards_north) ||
           (before->state.towards_east != after->state.towards_east);
}

/* States that can arise. */
static bool possible(const cmec *m)
{
    bool holds = within(m->state.now, CMEC_MODE_IDLE, CMEC_MODE_STOPPED) && (m->state.ticks >= 0) &&
                 ((m->state.overruled == CMEC_ANOMALY_NONE) ||
                  within(m->state.overruled, CMEC_ANOMALY_LOST_LINK, CMEC_ANOMALY_BAD_INPUT)) &&
                 within(m->state.count, 1, 16) && within(m->state.reached, 0, 16) &&
                 (!going(m->state.now) || (m->state.reached < m->state.count)) &&
                 within(m->state.planned, CMEC_COMMAND_NONE, CMEC_COMMAND_RIGHT) && (m->state.turns >= 0) &&
                 (m->state.issued >= 0) && near(m->state.target_north) && near(m->state.target_east) &&
                 near(m->state.base_north) && near(m->state.base_east);

    for (int i = 0; i < 16; i++) {
        holds = holds && near(m->state.route_north[i]) && near(m->state.route_east[i]);
    }
    holds = holds && within(m->state.cue, CMEC_COMMAND_NONE, CMEC_COMMAND_RIGHT) && (m->state.cue_ticks >= 0);
    holds = holds && (m->state.window_ticks >= 0) && within(m->state.survey_ticks, 0, 4);
    holds = holds && ((m->out.mode == m->state.now) ||
                      ((m->out.mode == CMEC_MODE_STOPPED) && (m->state.now == CMEC_MODE_FAILURE_RECALL)));
    holds = holds && (m->state.still_ticks >= 0) && (m->state.leg_ticks >= 0) && (m->state.surveys >= 0);
    holds = holds && (m->state.led == (m->par.guarded && leads(m->out.mode)));
    holds = holds && within(m->state.breach, CMEC_ANOMALY_NONE, CMEC_ANOMALY_OUTSIDE_FENCE);
    holds = holds && within(m->state.corners, 0, 7) && !m->state.beside &&
            ((m->state.edge == 0) || within(m->state.edge, 1, m->state.corners - 1));
    if (!m->par.guarded) { /* then nothing sets them */
        holds = holds && (m->state.breach == CMEC_ANOMALY_NONE) && !m->state.fresh && !m->state.turned &&
                !m->state.over && !m->state.surveyed && !m->state.recalling;
    }
    return holds;
}

/* No counter has overflowed: it has not been two and a half years. */
static bool young(const cmec *m)
{
    bool holds = (m->state.ticks <= MOST) && (m->state.turns < MOST) && (m->state.issued < MOST) && (m->state.cue_ticks <= MOST) && (m->state.window_ticks <= MOST) &&
                 (m->state.still_ticks <= MOST) && (m->state.leg_ticks <= MOST) && (m->state.surveys <= MOST);

    for (int i = 0; i < 13; i++) {
        holds = holds && within(m->state.anomalies[i], 0, MOST);
    }
    return holds;
}

/* Any state and inputs of any bits; parameters as shipped, but for those of aiming off. A mission lies within
 * 100 km. */
static cmec any_controller(bool guarded)
{
    cmec m;

    m.par = shipped().controller.par;
    m.par.guarded = guarded;
    m.par.drift = float_in(-1.0F, 1.0F);
    m.par.drift_sd = float_in(0.0F, 1.0F);
    m.par.drift_persistence = float_in(0.0F, 1.0F);
    m.par.response_time = float_in(0.0F, 10.0F);
    m.par.response_sd = float_in(0.0F, 10.0F);
    m.par.braking = float_in(0.0F, 1.0e3F);
    m.mission.waypoint_count = int_in(1, 16);
    m.mission.home_north = float_in(-1.0e5F, 1.0e5F);
    m.mission.home_east = float_in(-1.0e5F, 1.0e5F);
    for (int i = 0; i < 16; i++) {
        m.mission.waypoint_north[i] = float_in(-1.0e5F, 1.0e5F);
        m.mission.waypoint_east[i] = float_in(-1.0e5F, 1.0e5F);
    }
    m.mission.fence_count = int_in(0, 7);
    for (int i = 0; i < 7; i++) {
        m.mission.fence_north[i] = float_in(-1.0e5F, 1.0e5F);
        m.mission.fence_east[i] = float_in(-1.0e5F, 1.0e5F);
    }
    m.state.beside = nondet_bool();
    m.state.inside = nondet_bool();
    m.state.uncounted = nondet_bool();
    m.state.exhausted = nondet_bool();
    m.state.led = nondet_bool();
    m.state.fresh = nondet_bool();
    m.state.turned = nondet_bool();
    m.state.over = nondet_bool();
    m.state.surveyed = nondet_bool();
    m.state.recalling = nondet_bool();
    m.state.early = nondet_bool();
    m.state.timed = nondet_bool();
    m.in.valid = nondet_bool();
    m.in.start = nondet_bool();
    m.in.link_ok = nondet_bool();
    __CPROVER_assume(possible(&m) && young(&m));
    return m;
}

/* The controller as the program starts it. */
static cmec started(void)
{
    cmec m;

    cmec_defaults(&m);
    m.par = shipped().controller.par;
    cmec_initialize(&m);
    assert(possible(&m) && young(&m));
    return m;
}

#endif
