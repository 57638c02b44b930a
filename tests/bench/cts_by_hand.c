/* The Canine Trial Simulator (Miller 2010, chapter 5) as one writes it by hand for speed, without vectors.

   One trial after another, a loop over 25 Hz ticks, a switch over the controller's mode, libm. The controller
   sees the dog's true state. Left out is what decides nothing here: the pack's swing, an invalid estimate,
   bad input, the operator and the radio link, and cruise speeds and accelerations drawn per trial (their
   deviations are 0 by default).

   Compiled as it stands, each mode does only the work that it needs: no direction to the target while waiting or
   homing, no turn of the body on recall, no sine and cosine at rest, squared distances. With EVERY_EQUATION it
   does on each tick what the text has on each tick: d and h (eq. 4.1-4.4), which the controller answers, and the
   motion (D.9-D.11). */
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

#define PI 3.14159265358979323846
#define TICK 0.04 /* s */

typedef struct { /* SI units, radians; names as in the blocks cmec and canine */
    double capture_radius, stopped_speed, moving_deviation, stop_deviation, turn_end_deviation;
    double stop_hold, turn_timeout, forward_timeout, forward_distance, dead_time;
    double max_turns, limit_stop_deviation, count_reissue, reset_turns;
    double start_heading, start_heading_deviation, drift, drift_deviation;
    double right_turn_rate, right_turn_rate_deviation, left_turn_rate, left_turn_rate_deviation;
    double right_success, left_success, cruise_speed, speeding_up, slowing_down, recall_turn_rate;
} setting;

enum mode { FORWARD, STOP_TO_TURN, LEFT, RIGHT, DEAD, STOP_AT_WAYPOINT, RECALL };
enum status { RUNNING = 1, SUCCESS, FAILED };
enum { FORWARD_FAILURE, TURN_FAILURE, DIRECTION_SWITCH, NO_COMMAND, TRIAL_FAILURE, ANOMALIES };

typedef struct {
    int32_t status;               /* RUNNING: the time was up */
    int32_t ticks;                /* the tick on which the trial ended */
    int32_t directional_commands; /* LEFT and RIGHT issued */
    int32_t anomalies[ANOMALIES]; /* how often each was reported */
    double distance, deviation;   /* d and h by the last tick, with EVERY_EQUATION */
} outcome;

typedef struct {
    double north, east;
} point;

/* xoshiro256+ (Blackman and Vigna), its state filled by SplitMix64 */
typedef struct {
    uint64_t s[4];
} generator;

static void seed_generator(generator *g, uint64_t seed)
{
    for (int i = 0; i < 4; i++) {
        uint64_t z = seed += 0x9e3779b97f4a7c15u;
        z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
        z = (z ^ z >> 27) * 0x94d049bb133111ebu;
        g->s[i] = z ^ z >> 31;
    }
}

/* in (0, 1] */
static double uniform(generator *g)
{
    uint64_t *s = g->s;
    const uint64_t sum = s[0] + s[3], shifted = s[1] << 17;
    s[2] ^= s[0];
    s[3] ^= s[1];
    s[1] ^= s[2];
    s[0] ^= s[3];
    s[2] ^= shifted;
    s[3] = s[3] << 45 | s[3] >> 19;
    return (double)((sum >> 11) + 1) * 0x1p-53;
}

/* two standard normal numbers (Box and Muller) */
static void normals(generator *g, double *first, double *second)
{
    const double radius = sqrt(-2.0 * log(uniform(g))), angle = 2.0 * PI * uniform(g);
    *first = radius * cos(angle);
    *second = radius * sin(angle);
}

/* in (-pi, pi], of an angle less than a turn away from it */
static inline double wrap(double angle)
{
    return angle > PI ? angle - 2.0 * PI : angle <= -PI ? angle + 2.0 * PI : angle;
}

/* the first tick of a mode on which it has lasted so many seconds, less a tenth of a tick */
static int32_t lasting(double time)
{
    return (int32_t)floor(time / TICK - 0.1) + 1;
}

/* h of a target so far away (eq. 4.3, 4.4) */
static inline double off(double to_north, double to_east, double heading)
{
    return wrap(atan2(to_east, to_north) - heading);
}

#ifdef EVERY_EQUATION
#define DEVIATION result->deviation
#else
#define DEVIATION off(to_north, to_east, heading)
#endif

static void run_trial(const setting *p, int waypoints, const point *route, int32_t last_tick, generator *g,
                      outcome *result)
{
    enum mode mode = FORWARD, planned = FORWARD;
    const int32_t hold = lasting(p->stop_hold), turn_timeout = lasting(p->turn_timeout);
    const int32_t forward_timeout = lasting(p->forward_timeout), dead_time = lasting(p->dead_time);
    const double capture = p->capture_radius * p->capture_radius;
    const double limit = p->limit_stop_deviation != 0.0 ? fmin(p->stop_deviation, p->moving_deviation)
                                                        : p->stop_deviation;
    double north = 0.0, east = 0.0, speed = 0.0;
    double issue_north = 0.0, issue_east = 0.0;
    point target = route[0];
    int32_t ticks = 0; /* since the mode was entered */
    int reached = 0, turns = 0;
    bool uncounted = false, obeys = false;
    double heading, drift, right_rate, left_rate;
    int32_t tick;

    normals(g, &heading, &drift);
    normals(g, &right_rate, &left_rate);
    heading = wrap(p->start_heading + p->start_heading_deviation * heading);
    drift = p->drift + p->drift_deviation * drift;
    right_rate = p->right_turn_rate + p->right_turn_rate_deviation * right_rate;
    left_rate = p->left_turn_rate + p->left_turn_rate_deviation * left_rate;
    *result = (outcome){.status = RUNNING};

    for (tick = 0;; tick++, ticks++) {
        double to_north = target.north - north, to_east = target.east - east;
        const double squared = to_north * to_north + to_east * to_east;
        bool choose = false; /* forward, left or right */
        double deviation = 0.0;
#ifdef EVERY_EQUATION
        result->distance = sqrt(squared);
        result->deviation = off(to_north, to_east, heading);
#endif

        /* the controller: Figure 4.2, Table 4.3 */
        if (squared <= capture && mode != STOP_AT_WAYPOINT) {
            if (mode == RECALL) {
                result->status = SUCCESS;
                break;
            }
            if (mode == DEAD) {
                result->anomalies[NO_COMMAND]++;
            }
            if (mode != STOP_TO_TURN) { /* else the stop command is on already */
                ticks = 0;
            }
            mode = STOP_AT_WAYPOINT;
        } else {
            switch (mode) {
            case FORWARD:
                deviation = DEVIATION;
                if (fabs(deviation) >= p->moving_deviation) {
                    mode = STOP_TO_TURN;
                    ticks = 0;
                } else if (ticks == forward_timeout) {
                    const double moved_north = north - issue_north, moved_east = east - issue_east;
                    if (moved_north * moved_north + moved_east * moved_east <
                        p->forward_distance * p->forward_distance) {
                        result->anomalies[FORWARD_FAILURE]++;
                        mode = DEAD;
                        planned = FORWARD;
                        ticks = 0;
                    }
                }
                break;
            case STOP_TO_TURN:
                choose = ticks >= hold && speed < p->stopped_speed;
                break;
            case LEFT:
            case RIGHT:
                deviation = DEVIATION;
                if (fabs(deviation) < p->turn_end_deviation) {
                    mode = FORWARD;
                    issue_north = north;
                    issue_east = east;
                    ticks = 0;
                } else if (fabs(deviation) >= limit && (mode == RIGHT ? deviation < 0.0 : deviation > 0.0)) {
                    result->anomalies[DIRECTION_SWITCH]++;
                    planned = mode == RIGHT ? LEFT : RIGHT;
                    uncounted = false;
                    mode = DEAD;
                    ticks = 0;
                } else if (ticks >= turn_timeout) {
                    result->anomalies[TURN_FAILURE]++;
                    planned = mode;
                    uncounted = p->count_reissue == 0.0;
                    mode = DEAD;
                    ticks = 0;
                }
                break;
            case DEAD:
                if (ticks >= dead_time && planned == FORWARD) {
                    deviation = DEVIATION;
                    if (fabs(deviation) < p->moving_deviation) {
                        mode = FORWARD;
                        issue_north = north;
                        issue_east = east;
                    } else {
                        result->anomalies[NO_COMMAND]++;
                        mode = STOP_TO_TURN;
                    }
                    ticks = 0;
                } else {
                    choose = ticks >= dead_time;
                }
                break;
            case STOP_AT_WAYPOINT:
                if (ticks >= hold && speed < p->stopped_speed) {
                    turns = p->reset_turns != 0.0 ? 0 : turns;
                    reached++;
                    choose = reached < waypoints;
                    target = choose ? route[reached] : (point){0.0, 0.0};
                    to_north = target.north - north;
                    to_east = target.east - east;
#ifdef EVERY_EQUATION
                    result->distance = sqrt(to_north * to_north + to_east * to_east);
                    result->deviation = off(to_north, to_east, heading);
#endif
                    if (!choose) {
                        mode = RECALL;
                    }
                }
                break;
            case RECALL:
                break;
            }
        }
        if (choose) {
            const bool was_dead = mode == DEAD;
            deviation = off(to_north, to_east, heading);
            if (fabs(deviation) < limit) {
                mode = FORWARD;
                issue_north = north;
                issue_east = east;
            } else {
                mode = deviation >= 0.0 ? RIGHT : LEFT;
                if (!(was_dead && uncounted && mode == planned)) {
                    if (turns >= p->max_turns) {
                        result->anomalies[TRIAL_FAILURE]++;
                        result->status = FAILED;
                        break;
                    }
                    turns++;
                }
                result->directional_commands++;
                obeys = uniform(g) <= (mode == RIGHT ? p->right_success : p->left_success); /* eq. 5.3, 5.4 */
            }
            if (was_dead && mode != planned) {
                result->anomalies[NO_COMMAND]++;
            }
            ticks = 0;
        }
        if (tick == last_tick) {
            break;
        }

        /* the dog: it brakes on whatever does not tell it to run, and drifts while it moves */
        const double before = speed;
        if (mode == RECALL) { /* straight to the start, which the controller aims at as well */
            speed = fmin(before + p->speeding_up * TICK, p->cruise_speed);
            const double step = 0.5 * (before + speed) * TICK;
#ifdef EVERY_EQUATION
            const double bearing = atan2(to_east, to_north), most = p->recall_turn_rate * TICK;
            heading = wrap(heading + fmax(-most, fmin(most, wrap(bearing - heading))));
            north += step * cos(bearing);
            east += step * sin(bearing);
#else
            const double distance = sqrt(to_north * to_north + to_east * to_east);
            if (distance > 0.0) {
                north += step / distance * to_north;
                east += step / distance * to_east;
            }
#endif
            continue;
        }
        double turn_rate = 0.0;
        if (mode == FORWARD) {
            turn_rate = drift;
            speed = fmin(before + p->speeding_up * TICK, p->cruise_speed);
        } else {
            if (before > 0.0) {
                turn_rate = drift;
                speed = fmax(before - p->slowing_down * TICK, 0.0);
            }
            if (mode == RIGHT && obeys) {
                turn_rate += right_rate;
            } else if (mode == LEFT && obeys) {
                turn_rate += left_rate;
            }
        }
        heading = wrap(heading + turn_rate * TICK);
        const double step = 0.5 * (before + speed) * TICK;
#ifndef EVERY_EQUATION
        if (step == 0.0) {
            continue;
        }
#endif
        north += step * cos(heading);
        east += step * sin(heading);
    }
    result->ticks = tick;
}

__attribute__((visibility("default"))) void cts_by_hand(const setting *parameters, int32_t waypoints,
                                                        const point *route, int32_t last_tick, int64_t trials,
                                                        uint64_t seed, outcome *outcomes);

void cts_by_hand(const setting *parameters, int32_t waypoints, const point *route, int32_t last_tick,
                 int64_t trials, uint64_t seed, outcome *outcomes)
{
    generator g;
    seed_generator(&g, seed);
    for (int64_t i = 0; i < trials; i++) {
        run_trial(parameters, waypoints, route, last_tick, &g, &outcomes[i]);
    }
}
