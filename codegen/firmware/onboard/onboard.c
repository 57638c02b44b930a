/* onboard: the program on the vest: drivers, estimator, controller and command module, 25 times a second
 * Source: Miller 2010, 2.3, 2.4, Chapters 3 and 4.
 *
 * Failures end in a stop: a silent receiver makes the estimate old and invalid, and the watchdog notices a
 * silent inertial unit or operator. The controller then stops the animal. */
#include "onboard.h"

#include "key.h"
#include "navigation.h"
#include "port.h"

#include <stddef.h>
#include <string.h>

#define LONGEST_PAUSE 5U     /* ticks: the longest pause in a frame from the radio, two packets */
#define LONGEST_WAIT 2U      /* ticks: telemetry lets a fix and then a message go first */
#define FARTHEST 1.0e5f      /* m: the controller's range of positions */
#define QUARTER 900000000    /* 1e-7 deg: 90 deg */
#define HALF 1800000000      /* 1e-7 deg: 180 deg */
#define MAX_SHIFT 100000000  /* 1e-7 deg: limit of an estimate's distance from the origin in telemetry */
#define ORIGIN_H_ACC 100000U /* mm, mm/s: accuracy that a fix needs to settle the plane */
#define ORIGIN_S_ACC 10000U
#define ISSUES 0U /* places in the controller's budget */
#define VIBRATION 1U
#define TONE 2U

#ifndef CMEC_CAPTURE_RADIUS /* a bundle with constants has them */
#define CMEC_CAPTURE_RADIUS (m->controller.par.capture_radius)
#define CMEC_GUARDED (m->controller.par.guarded)
#define CMEC_WINDOW_ISSUES (m->controller.par.window_issues)
#define CMEC_WINDOW_VIBRATION (m->controller.par.window_vibration)
#define CMEC_WINDOW_TONE (m->controller.par.window_tone)
#endif

/* Get the next bytes of a source; `blocks` counts those that may still be read in this tick. Returns false if
 * there are none. */
static bool next_bytes(port_source source, scanner_input *input, uint8_t *blocks)
{
    if (*blocks > 0U) { /* else the input is used up */
        *blocks = (uint8_t)(*blocks - 1U);
        input->count = port_receive(source, &input->bytes);
    }
    return input->count > 0U;
}

/* A new mission, or a new plane: the mission held must be projected. Nothing tells against it so far. */
static void replan(onboard *m)
{
    m->planned = false;
    m->place = 0U;
    m->route = READY_REACH | READY_LEGS | READY_FENCE;
}

/* Let a message act. MISSION and ABORT undo a START before them, ABORT an override too (rule 9). */
static void apply(onboard *m, link_message message)
{
    switch (message) {
    case LINK_MISSION:
        m->asked = false;
        replan(m);
        break;
    case LINK_START:
        m->asked = true;
        break;
    case LINK_OVERRIDE:
        m->watchdog.in.overridden = true;
        break;
    case LINK_ABORT:
        m->asked = false;
        m->radio.override = 0U;
        m->controller.in.start = false;
        break;
    default: /* it only shows that the operator is there */
        break;
    }
}

/* Obey the operator's messages in the input. Returns whether there was one. While a mission is under way, or
 * has ended without an ABORT, no other is taken: what is held is what is led, and a MISSION that the laptop
 * repeats does not stop the animal. ABORT alone does. */
static bool obey(onboard *m, scanner_input *input)
{
    bool heard = false;
    link_message message;

    do {
        m->radio.locked = m->controller.in.start;
        message = link_receive(&m->radio, input);
        heard = heard || (message != LINK_NOTHING);
        apply(m, message);
    } while (message != LINK_NOTHING);
    return heard;
}

/* Listen to the radio. Returns whether there was a message. */
static bool hear_operator(onboard *m)
{
    scanner_input input = {NULL, 0U};
    uint8_t blocks = ONBOARD_BLOCKS;
    bool heard = false;

    if (m->pause < LONGEST_PAUSE) {
        m->pause++;
    } else {
        link_idle(&m->radio); /* the rest of the frame will not come */
    }
    while (next_bytes(PORT_RADIO, &input, &blocks)) {
        m->pause = 0U;
        heard = obey(m, &input) || heard;
    }
    if (m->pause == LONGEST_PAUSE) {
        heard = obey(m, &input); /* the messages behind the abandoned frame */
    }
    return heard;
}

static bool is_near(float coordinate)
{
    return (coordinate >= -FARTHEST) && (coordinate <= FARTHEST);
}

/* Is the position projected last within the controller's range? */
static bool on_plane(const onboard *m)
{
    return is_near(m->local_plane.out.north) && is_near(m->local_plane.out.east);
}

/* Project a position onto the plane: to `north` and `east` of local_plane.out. */
static void project(onboard *m, int32_t latitude, int32_t longitude, bool settle)
{
    m->local_plane.in.latitude = latitude;
    m->local_plane.in.longitude = longitude;
    m->local_plane.in.settle = settle;
    local_plane_step(&m->local_plane);
}

/* Project a fix onto the plane, which is settled at the first accurate fix. Before a trial it is settled
 * again at an accurate fix out of range: the vest has been carried away. Returns whether it is settled. */
static bool project_fix(onboard *m, const ubx_fix *fix)
{
    const bool accurate = (fix->h_acc <= ORIGIN_H_ACC) && (fix->s_acc <= ORIGIN_S_ACC);

    project(m, fix->latitude, fix->longitude, accurate && !m->local_plane.state.settled);
    if (accurate && !m->controller.in.start && !on_plane(m)) {
        project(m, fix->latitude, fix->longitude, true);
        replan(m);
    }
    return m->local_plane.state.settled;
}

/* The receiver's fixes; of several in one tick, the last. Returns whether there was one. */
static bool hear_receiver(onboard *m)
{
    scanner_input input = {NULL, 0U};
    uint8_t blocks = ONBOARD_BLOCKS;
    bool fixed = false;

    while (next_bytes(PORT_GPS, &input, &blocks)) {
        ubx_event event;

        do {
            event = ubx_receive(&m->gps, &input);
            fixed = fixed || (event == UBX_FIX);
        } while (event != UBX_NOTHING);
    }
    fixed = fixed && project_fix(m, &m->gps.fix);
    navigation_take_fix(m, fixed);
    return fixed;
}

/* The inertial unit's samples; of several in one tick, the last. */
static void hear_imu(onboard *m)
{
    scanner_input input = {NULL, 0U};
    uint8_t blocks = ONBOARD_BLOCKS;
    bool sampled = false;

    while (next_bytes(PORT_IMU, &input, &blocks)) {
        while (mt_receive(&m->imu, &input)) {
            sampled = true;
        }
    }
    navigation_take_sample(m, sampled);
}

/* Is a waypoint farther away than the capture radius? */
static bool is_apart(const onboard *m, uint8_t waypoint, float north, float east)
{
    const float radius = CMEC_CAPTURE_RADIUS;
    const float to_north = m->controller.mission.waypoint_north[waypoint] - north;
    const float to_east = m->controller.mission.waypoint_east[waypoint] - east;

    return ((to_north * to_north) + (to_east * to_east)) > (radius * radius);
}

/* Does the fence of the mission enclose a place? By the rule of models/fence.py; without a fence it does. */
static bool is_inside(const onboard *m, float north, float east)
{
    const uint8_t corners = m->radio.mission.corners;
    const float *const norths = m->controller.mission.fence_north;
    const float *const easts = m->controller.mission.fence_east;
    bool inside = corners == 0U;
    uint8_t before = (uint8_t)(corners - 1U);

    for (uint8_t i = 0U; i < corners; i++) {
        const float east_before = easts[before];

        if ((east_before > east) != (easts[i] > east)) {
            const float along_east = easts[i] - east_before;
            const float over = (norths[i] - norths[before]) * (east - east_before);
            const float under = along_east * (north - norths[before]);

            if ((along_east > 0.0f) ? (over > under) : (under > over)) {
                inside = !inside;
            }
        }
        before = i;
    }
    return inside;
}

/* Project the next place of the mission held onto the plane: one on a tick, its fence first, then home. */
static void plan(onboard *m)
{
    const link_mission *const held = &m->radio.mission;
    const link_position *place = &held->home;
    float *north = &m->controller.mission.home_north;
    float *east = &m->controller.mission.home_east;
    const uint8_t corners = held->corners;
    const bool waypoint = m->place > corners;
    const uint8_t i = waypoint ? (uint8_t)((m->place - corners) - 1U) : m->place;

    if (m->place < corners) {
        place = &held->fence[i];
        north = &m->controller.mission.fence_north[i];
        east = &m->controller.mission.fence_east[i];
    } else if (waypoint) {
        place = &held->waypoints[i];
        north = &m->controller.mission.waypoint_north[i];
        east = &m->controller.mission.waypoint_east[i];
    } else {
        /* home */
    }
    project(m, place->latitude, place->longitude, false);
    *north = m->local_plane.out.north;
    *east = m->local_plane.out.east;
    if (waypoint && (i > 0U) && !is_apart(m, i, m->controller.mission.waypoint_north[i - 1U],
                                          m->controller.mission.waypoint_east[i - 1U])) {
        m->route &= ~READY_LEGS;
    }
    if (!on_plane(m)) {
        m->route &= ~READY_REACH;
    }
    if ((m->place >= corners) && !is_inside(m, *north, *east)) {
        m->route &= ~READY_FENCE;
    }
    m->place = (uint8_t)(m->place + 1U);
    m->planned = m->place == (corners + 1U + held->count);
    m->controller.mission.waypoint_count = (int16_t)held->count;
    m->controller.mission.fence_count = (int16_t)corners;
}

/* The operator's command that is in force, 0 for none. STOP alone need not be renewed: it holds until another
 * is sent, or the link is lost, which stops the animal too (rule 9). */
static uint8_t override_of(const onboard *m)
{
    const bool holds = m->watchdog.out.override_ok || (m->radio.override == (uint8_t)CMEC_COMMAND_STOP);

    return holds ? m->radio.override : 0U;
}

/* Has VIBRATION or TONE been on in the window for less than a limit [s]? */
static bool leaves(const onboard *m, uint8_t kind, float limit)
{
    const int32_t ticks = m->controller.state.spent[kind] - m->controller.state.earlier_spent[kind];

    return ((0.001f * (float)ONBOARD_TICK_MS) * (float)ticks) < limit;
}

/* What a START needs (rule 8): the bits of `ready` of the telemetry. */
static uint32_t readiness(const onboard *m)
{
    uint32_t ready = m->route;

    if (m->watchdog.out.link_ok) {
        ready |= READY_LINK;
    }
    if (m->watchdog.out.imu_ok) {
        ready |= READY_IMU;
    }
    if (m->local_plane.state.settled) {
        ready |= READY_FIX;
        if ((float)m->gps.fix.h_acc <= (1000.0f * CMEC_CAPTURE_RADIUS)) {
            ready |= READY_ACCURACY;
        }
    }
    if (m->watchdog.out.estimate_ok) {
        ready |= READY_ESTIMATE;
    }
    if (m->radio.mission.count > 0U) {
        ready |= READY_MISSION;
        if (!m->planned || is_apart(m, 0U, m->estimator.out.north, m->estimator.out.east)) {
            ready |= READY_FIRST_LEG;
        }
        if (!m->planned || is_inside(m, m->estimator.out.north, m->estimator.out.east)) {
            ready |= READY_INSIDE;
        }
    }
    if (override_of(m) == 0U) {
        ready |= READY_RELEASED;
    }
    if (m->controller.out.mode == (int16_t)CMEC_MODE_IDLE) {
        ready |= READY_IDLE;
    }
    if (m->planned) {
        ready |= READY_PLANNED;
    }
    if (!CMEC_GUARDED ||
        (((m->controller.state.spent[ISSUES] - m->controller.state.earlier_spent[ISSUES]) < CMEC_WINDOW_ISSUES) &&
         leaves(m, VIBRATION, CMEC_WINDOW_VIBRATION) && leaves(m, TONE, CMEC_WINDOW_TONE))) {
        ready |= READY_BUDGET;
    }
    if (m->estimator.out.heading_ok) {
        ready |= READY_HEADING;
    }
    if ((m->battery_mv == 0U) || (m->battery_mv >= ONBOARD_LEAST_BATTERY_MV)) {
        ready |= READY_BATTERY;
    }
    if ((m->temperature == PORT_NO_TEMPERATURE) ||
        ((m->temperature >= ONBOARD_LEAST_TEMPERATURE) && (m->temperature <= ONBOARD_MOST_TEMPERATURE))) {
        ready |= READY_TEMPERATURE;
    }
    if (m->estimator.state.rejected == 0) {
        ready |= READY_AGREEMENT;
    }
    return ready;
}

/* The reason for which a START is refused: the first bit that is missing; 0 if none is. */
static uint8_t refusal_of(uint32_t ready)
{
    uint32_t missing = READY_ALL ^ ready;
    uint8_t refusal = 0U;

    if (missing != 0U) {
        refusal = REFUSAL_NOT_READY;
        while ((missing & 1U) == 0U) {
            missing >>= 1;
            refusal++;
        }
    }
    return refusal;
}

/* Is it time to project the next place? The tick that takes the mission is long enough without. */
static bool may_plan(const onboard *m)
{
    const bool taken = (m->place == 0U) && m->watchdog.in.heard;

    return !m->planned && m->local_plane.state.settled && (m->radio.mission.count > 0U) && !m->busy && !taken;
}

/* Answer a START that has come on this tick: begin the mission held, or refuse and forget it (rule 9). One that
 * repeats the START of the mission under way changes nothing. */
static void begin(onboard *m)
{
    if (may_plan(m)) {
        plan(m);
    }
    if (m->asked) {
        m->asked = false;
        if ((m->radio.mission.count > 0U) && (m->radio.asked != m->radio.mission.id)) {
            m->refusal = REFUSAL_OTHER_MISSION;
        } else if (!m->controller.in.start || (m->controller.out.status != (int16_t)CMEC_STATUS_RUNNING)) {
            m->refusal = refusal_of(readiness(m));
            if (m->refusal == 0U) {
                m->controller.in.start = true;
                m->last_anomaly = 0U;
            }
        } else {
            /* it is under way */
        }
    }
}

static void decide(onboard *m)
{
    m->controller.in.north = m->estimator.out.north;
    m->controller.in.east = m->estimator.out.east;
    m->controller.in.speed = m->estimator.out.speed;
    m->controller.in.speed_sd = m->estimator.out.speed_sd;
    m->controller.in.heading = m->estimator.out.heading;
    m->controller.in.valid = m->watchdog.out.estimate_ok;
    m->controller.in.override = (int16_t)override_of(m);
    m->controller.in.link_ok = m->watchdog.out.link_ok;
    cmec_step(&m->controller);
    if (m->controller.out.anomaly != (int16_t)CMEC_ANOMALY_NONE) {
        m->last_anomaly = (uint8_t)m->controller.out.anomaly;
    }
    if (m->controller.in.start && (m->controller.out.mode == (int16_t)CMEC_MODE_IDLE)) {
        m->controller.in.start = false; /* bad input kept it from beginning */
        m->refusal = REFUSAL_NO_ESTIMATE;
    }
    m->command_module.in.command = m->controller.out.command;
    command_module_step(&m->command_module);
    port_command_module((uint16_t)m->command_module.out.tone_hz, m->command_module.out.vibrate_left,
                        m->command_module.out.vibrate_right);
}

/* The nearest whole number within an interval, so that the conversion is defined. */
static int32_t whole(float value, int32_t lowest, int32_t highest)
{
    int32_t result;

    if (value <= (float)lowest) {
        result = lowest;
    } else if (value >= (float)highest) {
        result = highest;
    } else {
        result = (int32_t)(value + ((value < 0.0f) ? -0.5f : 0.5f));
    }
    return result;
}

static int16_t to_i16(float value)
{
    return (int16_t)whole(value, INT16_MIN, INT16_MAX);
}

static uint16_t to_u16(float value)
{
    return (uint16_t)whole(value, 0, (int32_t)UINT16_MAX);
}

static uint8_t to_u8(int16_t value)
{
    return (value > (int16_t)UINT8_MAX) ? UINT8_MAX : (uint8_t)value;
}

static uint16_t low_word(uint32_t count)
{
    return (uint16_t)(count & 0xFFFFU);
}

static uint16_t at_most_u16(uint32_t count)
{
    return (count > UINT16_MAX) ? (uint16_t)UINT16_MAX : (uint16_t)count;
}

/* Beyond a pole the meridian goes on at the opposite longitude; longitudes stay within half a turn. No sum
 * leaves 32 bits: both come within MAX_SHIFT of their ranges. */
static void keep_on_earth(int32_t *latitude, int32_t *longitude)
{
    if ((*latitude > QUARTER) || (*latitude < -QUARTER)) {
        *latitude = ((*latitude > 0) ? HALF : -HALF) - *latitude;
        *longitude += (*longitude > 0) ? -HALF : HALF;
    }
    if (*longitude > HALF) {
        *longitude = (*longitude - HALF) - HALF;
    } else if (*longitude < -HALF) {
        *longitude = (*longitude + HALF) + HALF;
    } else {
        /* within half a turn */
    }
}

/* What the budget leaves of issues, vibration or tones: issues, or ticks (rule 3). Without limits it is endless. */
static uint32_t left_of(const onboard *m, uint8_t kind)
{
    const int32_t left = m->controller.state.allowance[kind] - m->controller.state.spent[kind];

    return CMEC_GUARDED ? ((left > 0) ? (uint32_t)left : 0U) : (UINT32_MAX / ONBOARD_TICK_MS);
}

static uint16_t time_left(const onboard *m, uint8_t kind)
{
    return at_most_u16((left_of(m, kind) * ONBOARD_TICK_MS) / 100U);
}

static void report(onboard *m)
{
    uint8_t frame[LINK_TELEMETRY_SIZE];
    telemetry t;
    const float north_sd = m->estimator.out.north_sd;
    const float east_sd = m->estimator.out.east_sd;

    m->battery_mv = port_battery_mv(); /* first on the first tick, before any START can begin */
    m->temperature = port_temperature();
    (void)memset(&t, 0, sizeof(t));
    t.time_ms = m->time_ms;
    if (m->local_plane.state.settled) {
        const float north = m->estimator.out.north / m->local_plane.state.north_scale;
        const float east = m->estimator.out.east / m->local_plane.state.east_scale;

        t.latitude = m->local_plane.state.origin_latitude + whole(north, -MAX_SHIFT, MAX_SHIFT);
        t.longitude = m->local_plane.state.origin_longitude + whole(east, -MAX_SHIFT, MAX_SHIFT);
        keep_on_earth(&t.latitude, &t.longitude);
    }
    t.speed = to_i16(100.0f * m->estimator.out.speed);
    t.heading = to_i16(1.0e4f * m->estimator.out.heading);
    t.position_sd = to_u16(100.0f * ((north_sd > east_sd) ? north_sd : east_sd));
    t.speed_sd = to_u16(100.0f * m->estimator.out.speed_sd);
    t.distance = to_u16(10.0f * m->controller.out.distance);
    t.deviation = to_i16(1.0e4f * m->controller.out.deviation);
    t.directional_commands = at_most_u16((uint32_t)m->controller.out.directional_commands);
    t.command = to_u8(m->controller.out.command);
    t.mode = to_u8(m->controller.out.mode);
    t.status = to_u8(m->controller.out.status);
    t.waypoint = to_u8(m->controller.out.waypoint);
    t.anomaly = to_u8(m->controller.state.overruled);
    t.last_anomaly = m->last_anomaly;
    t.issues_left = at_most_u16(left_of(m, ISSUES));
    t.vibration_left = time_left(m, VIBRATION);
    t.tone_left = time_left(m, TONE);
    t.valid = m->estimator.out.valid;
    t.imu_ok = m->watchdog.out.imu_ok;
    t.link_ok = m->watchdog.out.link_ok;
    t.fixed = m->local_plane.state.settled;
    t.loaded = m->radio.mission.count > 0U;
    t.started = m->controller.in.start;
    t.insecure = !KEY_SIGNS;
    t.ready = readiness(m);
    t.refusal = m->refusal;
    t.mission_id = m->radio.mission.id;
    t.received = m->radio.received;
    t.session = m->radio.session;
    t.nonce = m->radio.nonce;
    t.gps_frames = low_word(m->gps.scanner.frames);
    t.gps_errors = at_most_u16(m->gps.scanner.errors);
    t.imu_frames = low_word(m->imu.scanner.frames);
    t.imu_errors = at_most_u16(m->imu.scanner.errors);
    t.link_errors = at_most_u16(m->radio.scanner.errors);
    t.link_forged = at_most_u16(m->radio.forged);
    t.link_replayed = at_most_u16(m->radio.replayed);
    t.rejected_fixes = (uint16_t)m->estimator.out.rejected_fixes;
    t.jumps = to_u8(m->estimator.out.jumps);
    t.recoveries = to_u8(m->estimator.out.recoveries);
    t.battery = m->battery_mv;
    t.temperature = m->temperature;
    port_send(frame, link_write_telemetry(&m->radio, frame, &t));
}

void onboard_init(onboard *m)
{
    (void)memset(m, 0, sizeof(*m));
    ubx_init(&m->gps);
    mt_init(&m->imu, ONBOARD_IMU_Z_UP);
    link_init(&m->radio, port_session());
    local_plane_defaults(&m->local_plane);
    navigation_defaults(m);
    watchdog_defaults(&m->watchdog);
    cmec_defaults(&m->controller);
    command_module_defaults(&m->command_module);
    onboard_parameters(m);
    local_plane_initialize(&m->local_plane);
    navigation_initialize(m);
    watchdog_initialize(&m->watchdog);
    cmec_initialize(&m->controller);
    command_module_initialize(&m->command_module);
}

void onboard_tick(onboard *m)
{
    const bool fixed = hear_receiver(m);
    const bool busy = fixed && !m->busy; /* a fix takes long: the radio waits for one tick */

    m->busy = busy;
    m->watchdog.in.overridden = false;
    m->watchdog.in.heard = !busy && hear_operator(m);
    hear_imu(m);
    m->watchdog.in.sampled = navigation_step(m); /* no sample is one that is refused */
    m->watchdog.in.valid = m->estimator.out.valid;
    watchdog_step(&m->watchdog);
    if (!m->watchdog.out.link_ok) {
        m->radio.override = 0U; /* whoever comes back orders anew */
    }
    begin(m);
    decide(m);
    m->reporting = m->reporting || m->watchdog.out.report;
    if (m->reporting && (busy || m->watchdog.in.heard) && (m->waited < LONGEST_WAIT)) {
        m->waited++;
    } else if (m->reporting) {
        m->reporting = false;
        m->waited = 0U;
        report(m);
    } else {
        /* none is due */
    }
    m->time_ms += ONBOARD_TICK_MS;
}
