/* The whole onboard program, tick by tick, with bytes that the input chooses, from all three sources.
 * The input is a list of orders: raw bytes, values wrapped into valid frames here, damage to bytes not read
 * yet, and ticks. In the background a walking animal, which can be ordered to obey, gives fixes and samples,
 * so that few bytes lead far into a mission. After every tick the results are checked against values
 * computed anew. */
#include "fixes.h"
#include "offsets.h"
#include "onboard.h"
#include "port.h"
#include "signed.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* The modes that the controller has been in, a bit for each: they show how far an input leads. */
uint32_t fuzz_modes(void);

/* Generated from the declarations: every value is finite and within its declared range. */
void check_declared(const onboard *m);

#define MOST_TICKS 6000U
#define QUEUE 4096U
#define FRAMES 1024U
#define FIX_TICKS 6U   /* between two fixes in the background */
#define HEARD_TICKS 10U
#define REPORT_TICKS 5U
#define LONGEST_SILENCE 50U      /* ticks: 2 s of the radio */
#define LONGEST_IMU_SILENCE 5U   /* ticks: 0.2 s */
#define OLDEST_FIX 375U          /* ticks: 15 s */
#define MOST_DULL 10U            /* ticks: 0.4 s */
#define HEADING_LIMIT 0.785398163F /* rad: 45 deg */
#define HEADING_TIME 3.0F        /* s */
#define LONGEST_OVERRIDE 25U     /* ticks: 1 s */
#define CAPTURE_RADIUS 7.0       /* m */
#define LONGEST_VIBRATION 125U   /* ticks: 5 s */
#define MOST_VIBRATION 4500U     /* ticks: 180 s in a mission */
#define MOST_ISSUES 60U
#define HELD_STOP 38U            /* ticks: 1.5 s */
#define STEP_PER_M 90.0          /* 1e-7 deg in a metre */
#define RADIANS 0.017453292519943295
#define TWO_PI 6.283185307179586

enum { RAW, NAV, FIX, SAMPLE, MESSAGE, MISSION, START, DAMAGE, BACKGROUND, TICK, TICKS, MOST, FORGED, REPLAY, ORDERS };

enum { GIVE_SAMPLES = 1, GIVE_FIXES = 2, GIVE_HEARTBEATS = 4, AS_PVT = 8, OBEY = 16 };

typedef struct {
    uint8_t bytes[QUEUE];
    size_t begin;
    size_t end;
} queue;

static struct {
    const uint8_t *data;
    size_t left;
} orders;

/* A genuine frame that was on the air. */
typedef struct {
    uint32_t counter;
    uint8_t type;
    uint8_t n;
    uint8_t value; /* the first byte of its payload */
} sent_frame;

static struct {
    queue sources[PORT_SOURCES];
    uint32_t taken[PORT_SOURCES]; /* bytes read in this tick */
    uint16_t most;                /* bytes that are given at once */
    unsigned background;
    double latitude; /* 1e-7 deg, of the animal */
    double longitude;
    double home_latitude;
    double home_longitude;
    float heading; /* deg */
    float speed;   /* m/s */
    uint32_t fix_time; /* ms */
    uint16_t counter;  /* of samples */
    uint32_t number;    /* of the last message, its counter */
    uint32_t told;      /* counter of the last telemetry */
    uint32_t genuine;   /* frames with a right tag that the radio has brought */
    sent_frame frames[FRAMES]; /* the last of them */
    uint8_t override;          /* the operator's, 0 for none */
    uint8_t air[4U * QUEUE]; /* the radio's last bytes */
    size_t aired;
    uint8_t last[SIGNED_OVERHEAD + 255U]; /* the last frame sent */
    uint16_t mission_id;
    uint16_t tone;
    bool left;
    bool right;
    uint32_t ticks;
    uint32_t silence;     /* ticks without a valid message */
    uint32_t imu_silence; /* ticks without a sample */
    uint32_t override_age; /* ticks without an override */
    uint32_t dull;         /* ticks without a sample that the estimator can use and that says something new */
    float last_sample;     /* sum of its values */
    float facing;          /* rad: heading of the last sample used */
    uint32_t fix_gap;      /* ticks since a fix that the estimator can use */
    float contradiction;   /* s, of heading and course */
    bool contradicted;
    int32_t rejections; /* as the estimator told after the last fix that it can use */
    int32_t recoveries;
    bool rejecting;     /* that fix was rejected, and the filter did not begin anew at it */
    uint32_t reports;     /* frames sent in this tick */
    bool due;             /* telemetry is due */
    int32_t last_mode;
    int32_t last_command;
    uint32_t sounded;  /* ticks of this command */
    uint32_t vibrated; /* ticks, and issues, since the trial began */
    uint32_t issues;
    uint32_t late;        /* ticks for which it has waited */
    uint8_t telemetry[LINK_TELEMETRY_SIZE];
} world;

onboard vest;
static uint32_t modes;

/* --- the board --- */

uint32_t port_session(void)
{
    return SIGNED_SESSION;
}

/* This board tells neither. */
uint16_t port_battery_mv(void)
{
    return 0U;
}

int16_t port_temperature(void)
{
    return PORT_NO_TEMPERATURE;
}

/* A block of exactly its size, freed when its place is the board's again: reading beyond it or later is
 * found. */
uint16_t port_receive(port_source source, const uint8_t **bytes)
{
    static uint8_t *blocks[PORT_SOURCES];
    queue *const q = &world.sources[source];
    const size_t waiting = q->end - q->begin;
    const uint16_t n = (waiting < world.most) ? (uint16_t)waiting : world.most;

    free(blocks[source]);
    blocks[source] = malloc(n);
    memcpy(blocks[source], &q->bytes[q->begin], n);
    *bytes = blocks[source];
    q->begin += n;
    if (q->begin == q->end) {
        q->begin = 0U;
        q->end = 0U;
    }
    world.taken[source] += n;
    return n;
}

void port_send(const uint8_t *bytes, uint16_t count)
{
    assert(count == LINK_TELEMETRY_SIZE);
    memcpy(world.telemetry, bytes, count);
    world.reports++;
}

void port_command_module(uint16_t tone_hz, bool vibrate_left, bool vibrate_right)
{
    world.tone = tone_hz;
    world.left = vibrate_left;
    world.right = vibrate_right;
}

/* A byte on the air: does a genuine frame end with it? It may begin at any byte that looks so. */
static void air(uint8_t byte)
{
    if (world.aired == sizeof(world.air)) {
        world.aired = SIGNED_OVERHEAD + 255U;
        memmove(world.air, &world.air[sizeof(world.air) - world.aired], world.aired);
    }
    world.air[world.aired] = byte;
    world.aired++;
    for (size_t n = 0U; (n <= 255U) && ((n + SIGNED_OVERHEAD) <= world.aired); n++) {
        const uint8_t *const f = &world.air[world.aired - n - SIGNED_OVERHEAD];

        if ((f[0] == 0xA5U) && (f[1] == 0x5AU) && (f[3] == n) && signed_intact(f) && signed_genuine(f)) {
            world.frames[world.genuine % FRAMES].counter =
                ((uint32_t)f[4] << 24) | ((uint32_t)f[5] << 16) | ((uint32_t)f[6] << 8) | f[7];
            world.frames[world.genuine % FRAMES].type = f[2];
            world.frames[world.genuine % FRAMES].n = f[3];
            world.frames[world.genuine % FRAMES].value = f[8];
            world.genuine++;
        }
    }
}

static void put(port_source source, const uint8_t *bytes, size_t n)
{
    queue *const q = &world.sources[source];

    if (n <= (QUEUE - q->end)) {
        memcpy(&q->bytes[q->end], bytes, n);
        q->end += n;
        if (source == PORT_RADIO) {
            for (size_t i = 0U; i < n; i++) {
                air(bytes[i]);
            }
        }
    }
}

/* --- the input --- */

static uint8_t next_u8(void)
{
    uint8_t value = 0U;

    if (orders.left > 0U) {
        value = *orders.data;
        orders.data++;
        orders.left--;
    }
    return value;
}

static void next_bytes(uint8_t *bytes, size_t n)
{
    for (size_t i = 0U; i < n; i++) {
        bytes[i] = next_u8();
    }
}

static uint32_t next_u32(void)
{
    uint32_t value = next_u8();

    value |= (uint32_t)next_u8() << 8;
    value |= (uint32_t)next_u8() << 16;
    value |= (uint32_t)next_u8() << 24;
    return value;
}

static int16_t next_i16(void)
{
    const unsigned low = next_u8();

    return (int16_t)(uint16_t)(low | ((unsigned)next_u8() << 8));
}

/* --- frames, written without the program's code --- */

static void little(uint8_t *bytes, uint32_t value)
{
    for (unsigned i = 0U; i < 4U; i++) {
        bytes[i] = (uint8_t)((value >> (8U * i)) & 0xFFU);
    }
}

static void big(uint8_t *bytes, uint32_t value)
{
    for (unsigned i = 0U; i < 4U; i++) {
        bytes[i] = (uint8_t)((value >> (24U - (8U * i))) & 0xFFU);
    }
}

static void send_nav(uint8_t message, const uint8_t *payload, uint8_t n)
{
    uint8_t frame[8 + 255] = {0xB5U, 0x62U, 0x01U, message, n, 0U};
    unsigned a = 0U;
    unsigned b = 0U;

    memcpy(&frame[6], payload, n);
    for (size_t i = 2U; i < (6U + (size_t)n); i++) {
        a += frame[i];
        b += a;
    }
    frame[6U + (size_t)n] = (uint8_t)(a & 0xFFU);
    frame[7U + (size_t)n] = (uint8_t)(b & 0xFFU);
    put(PORT_GPS, frame, 8U + (size_t)n);
}

static void send_fix(const ubx_fix *fix, bool pvt, uint8_t gps_fix, uint8_t flags)
{
    uint8_t payload[92] = {0U};

    little(payload, fix->time_ms);
    if (pvt) {
        payload[11] = 2U; /* validTime */
        payload[20] = gps_fix;
        payload[21] = flags;
        little(&payload[24], (uint32_t)fix->longitude);
        little(&payload[28], (uint32_t)fix->latitude);
        little(&payload[40], fix->h_acc);
        little(&payload[60], fix->speed);
        little(&payload[64], (uint32_t)fix->course);
        little(&payload[68], fix->s_acc);
        send_nav(UBX_NAV_PVT, payload, 92U);
    } else {
        little(&payload[4], (uint32_t)fix->longitude);
        little(&payload[8], (uint32_t)fix->latitude);
        little(&payload[20], fix->h_acc);
        send_nav(UBX_NAV_POSLLH, payload, 28U);
        payload[10] = gps_fix;
        payload[11] = flags;
        send_nav(UBX_NAV_SOL, payload, 52U);
        little(&payload[20], fix->speed);
        little(&payload[24], (uint32_t)fix->course);
        little(&payload[28], fix->s_acc);
        send_nav(UBX_NAV_VELNED, payload, 36U);
    }
}

static void send_sample(uint32_t accel, uint32_t pitch, uint32_t yaw)
{
    uint8_t frame[55] = {0xFAU, 0xFFU, 0x32U, 50U};
    unsigned sum = 0U;

    big(&frame[4], accel);
    big(&frame[44], pitch);
    big(&frame[48], yaw);
    frame[52] = (uint8_t)(world.counter >> 8);
    frame[53] = (uint8_t)(world.counter & 0xFFU);
    world.counter = (uint16_t)((world.counter + 1U) & 0xFFFFU);
    for (size_t i = 1U; i < 54U; i++) {
        sum += frame[i];
    }
    frame[54] = (uint8_t)((0U - sum) & 0xFFU);
    put(PORT_IMU, frame, sizeof(frame));
}

/* A frame as the laptop makes it, or with a wrong tag. */
static void send_signed(uint8_t type, const uint8_t *payload, uint8_t n, bool genuine)
{
    uint8_t *const frame = world.last;
    const uint32_t least = world.told * 256U;

    world.number = (least > world.number) ? least : (world.number + 1U);
    memset(frame, 0, sizeof(world.last));
    frame[0] = 0xA5U;
    frame[1] = 0x5AU;
    frame[2] = type;
    frame[3] = n;
    big(&frame[4], world.number);
    memcpy(&frame[8], payload, n);
    signed_finish(frame, genuine);
    put(PORT_RADIO, frame, SIGNED_OVERHEAD + (size_t)n);
}

static void send_message(uint8_t type, const uint8_t *payload, uint8_t n)
{
    send_signed(type, payload, n, true);
    if ((type == (uint8_t)LINK_MISSION) && (n >= 2U)) {
        world.mission_id = (uint16_t)(((unsigned)payload[0] << 8) | payload[1]);
    }
}

/* --- orders --- */

static void order_nav(void)
{
    static const uint8_t kinds[4] = {UBX_NAV_POSLLH, UBX_NAV_SOL, UBX_NAV_PVT, UBX_NAV_VELNED};
    static const uint8_t sizes[4] = {28U, 52U, 92U, 36U};
    const uint8_t kind = next_u8() & 3U;
    uint8_t payload[92];

    next_bytes(payload, sizes[kind]);
    send_nav(kinds[kind], payload, sizes[kind]);
}

static void order_fix(void)
{
    const uint8_t style = next_u8();
    ubx_fix fix;

    fix.time_ms = world.fix_time;
    fix.latitude = (int32_t)next_u32();
    fix.longitude = (int32_t)next_u32();
    fix.h_acc = next_u32();
    fix.speed = next_u32();
    fix.course = (int32_t)next_u32();
    fix.s_acc = next_u32();
    world.fix_time = (world.fix_time < 604800000U) ? (world.fix_time + 250U) : 0U;
    send_fix(&fix, (style & 1U) != 0U, ((style & 2U) != 0U) ? (style >> 4) : 3U, ((style & 4U) != 0U) ? 0U : 1U);
    if ((style & 8U) != 0U) { /* the animal goes on from there */
        world.latitude = fmax(-9.0e8, fmin(9.0e8, fix.latitude));
        world.longitude = fmax(-1.8e9, fmin(1.8e9, fix.longitude));
    }
}

static void order_message(void)
{
    const uint8_t type = next_u8();
    const uint8_t n = next_u8();
    uint8_t payload[255];

    next_bytes(payload, n);
    send_message(type, payload, n);
}

static void order_forged(void)
{
    const uint8_t type = next_u8();
    const uint8_t n = next_u8();
    uint8_t payload[255];

    next_bytes(payload, n);
    send_signed(type, payload, n, false);
}

/* The last frame again. */
static void order_replay(void)
{
    put(PORT_RADIO, world.last, SIGNED_OVERHEAD + (size_t)world.last[3]);
}

/* A mission about the animal: corners of its fence, home, waypoints. */
static void order_mission(void)
{
    const size_t count = (size_t)next_u8() % 18U;
    const size_t corners = (size_t)next_u8() % 9U;
    uint8_t payload[3 + (8 * (8 + 18))] = {0U, (uint8_t)(world.number & 0xFFU), (uint8_t)corners};

    for (size_t i = 0U; i <= (corners + count); i++) {
        const double latitude = fmax(-9.0e8, fmin(9.0e8, world.latitude + next_i16()));
        const double longitude = fmax(-1.8e9, fmin(1.8e9, world.longitude + next_i16()));

        if (i == corners) {
            world.home_latitude = latitude;
            world.home_longitude = longitude;
        }
        big(&payload[3U + (8U * i)], (uint32_t)(int32_t)latitude);
        big(&payload[7U + (8U * i)], (uint32_t)(int32_t)longitude);
    }
    send_message(LINK_MISSION, payload, (uint8_t)(3U + (8U * (corners + 1U + count))));
}

static void order_start(void)
{
    const uint8_t id[2] = {(uint8_t)(world.mission_id >> 8), (uint8_t)(world.mission_id & 0xFFU)};

    send_message(LINK_START, id, 2U);
}

static void order_raw(void)
{
    const unsigned source = next_u8() % (unsigned)PORT_SOURCES;
    const uint8_t n = next_u8();
    uint8_t bytes[255];

    next_bytes(bytes, n);
    put((port_source)source, bytes, n);
}

static void order_damage(void)
{
    queue *const q = &world.sources[next_u8() % (unsigned)PORT_SOURCES];
    const size_t place = next_u8();
    const uint8_t mask = next_u8();

    if (place < (q->end - q->begin)) {
        q->bytes[q->begin + place] ^= mask;
    }
}

static void order_background(void)
{
    world.background = next_u8();
    world.heading = (float)next_u8() * (360.0F / 256.0F);
    world.speed = (float)next_u8() * 0.1F;
}

/* --- the animal --- */

static uint32_t bits(float value)
{
    uint32_t word;

    memcpy(&word, &value, sizeof(word));
    return word;
}

static void walk(void)
{
    if ((world.background & (unsigned)OBEY) != 0U) {
        world.speed = (world.tone == 1500U) || (world.tone == 9500U) ? 2.0F : ((world.tone != 0U) ? 0.0F : world.speed);
        world.heading += (world.right ? 2.0F : 0.0F) - (world.left ? 2.0F : 0.0F);
        world.heading -= 360.0F * floorf(world.heading / 360.0F);
    }
    if (((world.background & (unsigned)OBEY) != 0U) && (world.tone == 9500U)) { /* RECALL */
        const double turn = atan2(world.home_longitude - world.longitude, world.home_latitude - world.latitude);

        world.heading = (float)(fmod(turn + TWO_PI, TWO_PI) / RADIANS);
    }
    world.latitude += STEP_PER_M * 0.04 * (double)world.speed * cos(RADIANS * (double)world.heading);
    world.longitude += STEP_PER_M * 0.04 * (double)world.speed * sin(RADIANS * (double)world.heading);
    world.latitude = fmax(-9.0e8, fmin(9.0e8, world.latitude));
    world.longitude -= 3.6e9 * floor((world.longitude + 1.8e9) / 3.6e9);
}

static void give(void)
{
    if ((world.background & (unsigned)GIVE_SAMPLES) != 0U) {
        send_sample(bits(0.0F), bits(0.05F * (float)(world.ticks % 2U)), bits(180.0F - fmodf(world.heading + 180.0F, 360.0F)));
    }
    if (((world.background & (unsigned)GIVE_FIXES) != 0U) && ((world.ticks % FIX_TICKS) == 0U)) {
        const bool pvt = (world.background & (unsigned)AS_PVT) != 0U;
        const float unit = pvt ? 1.0e-3F : 1.0e-2F; /* m/s: of a receiver's speeds */
        const ubx_fix fix = {
            world.fix_time, (int32_t)world.latitude, (int32_t)world.longitude, 2000U,
            (uint32_t)(world.speed / unit), (int32_t)(1.0e5F * world.heading), pvt ? 200U : 20U};

        world.fix_time += 250U;
        send_fix(&fix, pvt, 3U, 1U);
    }
    if (((world.background & (unsigned)GIVE_HEARTBEATS) != 0U) && ((world.ticks % HEARD_TICKS) == 0U)) {
        const uint8_t nonce[4] = {1U, 2U, 3U, 4U};

        send_message(LINK_HEARTBEAT, nonce, 4U);
    }
}

/* --- what must hold --- */

static bool within(float value, float limit)
{
    return (value >= -limit) && (value <= limit);
}

/* Rule 6, from the estimator's inputs alone: a silent sensor, and a heading that courses contradict. */
static void judge_instruments(void)
{
    const float sum = (vest.estimator.in.accel_x + vest.estimator.in.pitch_meas) + vest.estimator.in.heading_meas;
    const bool good = within(vest.estimator.in.accel_x, 200.0F) && within(vest.estimator.in.pitch_meas, 4.0F) &&
                      within(vest.estimator.in.heading_meas, 7.0F);

    world.dull = (good && (sum != world.last_sample)) ? 0U : (world.dull + 1U);
    world.last_sample = good ? sum : world.last_sample;
    world.facing = (good && (world.dull <= MOST_DULL)) ? vest.estimator.in.heading_meas : world.facing;
    world.fix_gap++;
    if (vest.estimator.in.gps_fix && within(vest.estimator.in.gps_north, 1.0e5F) &&
        within(vest.estimator.in.gps_east, 1.0e5F) && (vest.estimator.in.gps_speed <= 50.0F) &&
        (vest.estimator.in.gps_h_acc >= 0.001F) && (vest.estimator.in.gps_h_acc <= 1000.0F) &&
        (vest.estimator.in.gps_s_acc >= 0.001F) && (vest.estimator.in.gps_s_acc <= 100.0F)) {
        const float time = fminf(0.04F * (float)world.fix_gap, 1.0F);
        const float turn = vest.estimator.in.gps_course - world.facing;
        const float off = turn + (6.2831855F * floorf(0.5F - (0.15915494F * turn)));

        world.fix_gap = 0U;
        world.rejecting = (vest.estimator.out.rejected_fixes != world.rejections) &&
                          (vest.estimator.out.recoveries == world.recoveries);
        world.rejections = vest.estimator.out.rejected_fixes;
        world.recoveries = vest.estimator.out.recoveries;
        if (vest.estimator.in.gps_speed > fmaxf(0.5F, 3.0F * vest.estimator.in.gps_s_acc)) {
            world.contradiction += (fabsf(off) > HEADING_LIMIT) ? time : -time;
            world.contradiction = fmaxf(0.0F, fminf(HEADING_TIME, world.contradiction));
            world.contradicted = (world.contradiction > 0.0F) &&
                                 (world.contradicted || (world.contradiction == HEADING_TIME));
        }
    }
}

static void check_estimate(void)
{
    for (unsigned i = 0U; vest.estimator.state.started && (i < 4U); i++) {
        assert(vest.estimator.state.covariance[i] > 0.0F);
    }
    assert((vest.estimator.out.north_sd >= 0.0F) && (vest.estimator.out.east_sd >= 0.0F));
    assert((vest.estimator.out.speed_sd >= 0.0F) && (vest.estimator.out.accel_bias_sd >= 0.0F));
    assert(fabsf(vest.estimator.out.heading) <= 3.1415930F); /* pi and one rounding of 2 pi */
    assert(vest.estimator.out.valid ==
           (vest.estimator.state.started && (vest.estimator.state.age <= (int32_t)OLDEST_FIX) &&
            (vest.estimator.out.north_sd <= 7.0F) && (vest.estimator.out.east_sd <= 7.0F) &&
            (vest.estimator.out.speed_sd <= 2.0F) &&
            (vest.estimator.out.heading_sd <= 0.523598776F) && /* rule 5 */
            !world.contradicted && (world.dull <= MOST_DULL))); /* rule 6 */
}

/* The command of a mode (Figure 4.2). */
static int32_t commanded(int32_t mode)
{
    switch (mode) {
    case CMEC_MODE_FORWARD:
        return CMEC_COMMAND_FORWARD;
    case CMEC_MODE_STOP_TO_TURN:
    case CMEC_MODE_STOP_AT_WAYPOINT:
    case CMEC_MODE_STOPPED:
        return CMEC_COMMAND_STOP;
    case CMEC_MODE_LEFT:
        return CMEC_COMMAND_LEFT;
    case CMEC_MODE_RIGHT:
        return CMEC_COMMAND_RIGHT;
    case CMEC_MODE_RECALL:
    case CMEC_MODE_FAILURE_RECALL:
        return CMEC_COMMAND_RECALL;
    default:
        return CMEC_COMMAND_NONE;
    }
}

static bool overridden(void)
{
    return (world.override == (uint8_t)CMEC_COMMAND_STOP) ||
           ((world.override != 0U) && (world.override_age <= LONGEST_OVERRIDE));
}

/* Rules 3 and 12, from the commands alone: nothing but the expected command, STOP, or silence; and no more of
 * it than a leg, a mission and a window allow. */
static void check_limits(int32_t expected, int32_t command)
{
    const bool directional = (command == CMEC_COMMAND_LEFT) || (command == CMEC_COMMAND_RIGHT);

    assert((command == expected) || (command == CMEC_COMMAND_STOP) || (command == CMEC_COMMAND_NONE));
    if ((world.last_mode == CMEC_MODE_IDLE) && (vest.controller.out.mode != CMEC_MODE_IDLE)) {
        world.vibrated = 0U;
        world.issues = 0U;
    }
    world.last_mode = vest.controller.out.mode;
    world.sounded = (command == world.last_command) ? (world.sounded + 1U) : 1U;
    if (directional) {
        world.vibrated++;
        world.issues += (command != world.last_command) ? 1U : 0U;
        assert(world.sounded <= LONGEST_VIBRATION);
    }
    world.last_command = command;
    assert((world.vibrated <= MOST_VIBRATION) && (world.issues <= MOST_ISSUES));
    if (vest.controller.out.mode == CMEC_MODE_IDLE) {
        assert((command != CMEC_COMMAND_STOP) || (world.sounded <= HELD_STOP));
    }
}

/* The order of precedence, from what the program was given: a lost link, the operator's override, bad input,
 * an invalid estimate, the table. */
static void check_command(void)
{
    const bool good = within(vest.estimator.out.north, 1.0e5F) && within(vest.estimator.out.east, 1.0e5F) &&
                      within(vest.estimator.out.speed, 50.0F) && within(vest.estimator.out.heading, 7.0F);
    const bool trusted = vest.estimator.out.valid && (world.imu_silence <= LONGEST_IMU_SILENCE);
    const int32_t mode = vest.controller.out.mode;
    int32_t expected;

    if (world.silence > LONGEST_SILENCE) {
        expected = CMEC_COMMAND_STOP;
    } else if (overridden()) {
        expected = (int32_t)world.override;
    } else if (!good || !trusted) {
        expected = CMEC_COMMAND_STOP;
    } else {
        expected = commanded(mode);
        assert(vest.controller.in.start || (mode == CMEC_MODE_IDLE) || (mode == CMEC_MODE_STOPPED));
    }
    check_limits(expected, vest.controller.out.command);
    assert(!vest.controller.in.start || vest.local_plane.state.settled);
    assert(!vest.asked && !(vest.controller.in.start && (mode == CMEC_MODE_IDLE))); /* nothing is remembered */
    assert(vest.controller.out.waypoint <= vest.controller.state.count);
    assert((vest.controller.state.count >= 1) && (vest.controller.state.count <= (int32_t)LINK_MAX_WAYPOINTS));
    for (int32_t i = 0; i < vest.controller.state.count; i++) {
        assert(within(vest.controller.state.route_north[i], 1.0e5F));
        assert(within(vest.controller.state.route_east[i], 1.0e5F));
    }
    assert(vest.controller.out.distance >= 0.0F);
    assert(fabsf(vest.controller.out.deviation) <= 3.1415930F);
}

/* No ABORT is held back behind another beginning (rule 10). */
static void check_held(void)
{
    const scanner *const s = &vest.radio.scanner;

    for (unsigned i = 0U; (i + SIGNED_OVERHEAD) <= s->count; i++) {
        assert(!signed_abort(&s->bytes[s->start + i]));
    }
}

/* Frames that the vest has accepted. */
static uint32_t accepted(void)
{
    return vest.radio.scanner.frames - vest.radio.forged - vest.radio.replayed;
}

/* Rule 11: no more frames are accepted than genuine ones were sent, and the counter grows with each. */
static void check_accepted(uint32_t accepted_before, uint32_t received_before)
{
    assert(accepted() <= world.genuine);
    assert((vest.radio.received > received_before) == (accepted() > accepted_before));
    assert(vest.radio.received >= received_before);
}

static bool is_override(const sent_frame *f)
{
    return (f->type == (uint8_t)LINK_OVERRIDE) && (f->n == 1U) && (f->value <= (uint8_t)CMEC_COMMAND_RIGHT);
}

static bool is_abort(const sent_frame *f)
{
    return (f->type == (uint8_t)LINK_ABORT) && (f->n == 0U);
}

/* The operator's override, from the genuine frames on the air. Those whose counters are among the ones that the
 * vest went through on this tick have come, if they are as many as it accepted; else (some were damaged on the
 * way) what it holds is that of one of them, or what it held. */
static void follow_override(uint32_t accepted_before, uint32_t received_before)
{
    const uint32_t taken = accepted() - accepted_before;
    const uint32_t oldest = (world.genuine > FRAMES) ? (world.genuine - FRAMES) : 0U;
    uint32_t fitting = 0U;
    uint32_t last = received_before;
    uint8_t override = world.override;
    bool renewed = false;
    bool possible = vest.radio.override == world.override;

    for (uint32_t i = oldest; i < world.genuine; i++) {
        const sent_frame *const f = &world.frames[i % FRAMES];

        if ((f->counter > last) && (f->counter <= vest.radio.received)) {
            fitting++;
            last = f->counter;
            if (is_override(f)) {
                override = f->value;
                renewed = true;
            } else if (is_abort(f)) {
                override = 0U;
            }
            possible = possible || (vest.radio.override == override);
        }
    }
    if (fitting == taken) {
        world.override = override;
        world.override_age = renewed ? 0U : (world.override_age + 1U);
    } else {
        assert(possible && (renewed || !vest.watchdog.in.overridden));
        world.override = vest.radio.override;
        world.override_age = vest.watchdog.in.overridden ? 0U : (world.override_age + 1U);
    }
}

/* From one place to another, by more than the controller's capture radius, as far as floats tell. */
static void check_leg(float north, float east, float to_north, float to_east)
{
    assert(hypot((double)to_north - (double)north, (double)to_east - (double)east) > (0.99999 * CAPTURE_RADIUS));
}

/* A coordinate latched by the controller is that of a place of the mission held, on the plane. */
static void check_place(const link_position *place, float north, float east)
{
    const local_plane *const plane = &vest.local_plane;
    const double to_north = (double)place->latitude - (double)plane->state.origin_latitude;
    const double to_east = (double)place->longitude - (double)plane->state.origin_longitude;
    const double turn = 3.6e9 * floor((to_east + 1.8e9) / 3.6e9); /* the short way round */

    assert(fabs((to_north * (double)plane->state.north_scale) - (double)north) < 0.05);
    assert(fabs(((to_east - turn) * (double)plane->state.east_scale) - (double)east) < 0.05);
}

/* A place is inside the fence that the controller has latched, if it goes round the place: the angles under which it
 * sees the edges are a full turn in sum. Within 0.1 m of an edge either answer will do. */
static void check_inside(float north, float east)
{
    const cmec *const c = &vest.controller;
    double seen = 0.0;
    bool near = c->state.corners == 0;

    for (int32_t i = 0; i < c->state.corners; i++) {
        const int32_t before = ((i > 0) ? i : c->state.corners) - 1;
        const double a_north = (double)c->state.corner_north[before] - (double)north;
        const double a_east = (double)c->state.corner_east[before] - (double)east;
        const double b_north = (double)c->state.corner_north[i] - (double)north;
        const double b_east = (double)c->state.corner_east[i] - (double)east;
        const double cross = (a_north * b_east) - (a_east * b_north);
        const double dot = (a_north * b_north) + (a_east * b_east);

        near = near || (hypot(a_north, a_east) < 0.1) ||
               ((dot <= 0.0) && (fabs(cross) < (0.1 * hypot(b_north - a_north, b_east - a_east))));
        seen += atan2(cross, dot);
    }
    assert(near || (fabs(seen) > 3.0));
}

/* A trial has begun on this tick: all that a START needs was there (rule 8). */
static void check_begun(int32_t mode_before)
{
    assert((mode_before == CMEC_MODE_IDLE) && (vest.refusal == 0U));
    assert((world.silence <= LONGEST_SILENCE) && (world.imu_silence <= LONGEST_IMU_SILENCE));
    assert(vest.estimator.out.valid && !overridden());
    assert((double)vest.gps.fix.h_acc <= (1000.001 * CAPTURE_RADIUS));
    assert((vest.radio.mission.count > 0U) && (vest.radio.mission.count == (uint32_t)vest.controller.state.count));
    assert(vest.radio.mission.corners == (uint32_t)vest.controller.state.corners);
    for (int32_t i = 0; i < vest.controller.state.corners; i++) {
        check_place(&vest.radio.mission.fence[i], vest.controller.state.corner_north[i],
                    vest.controller.state.corner_east[i]);
    }
    check_inside(vest.estimator.out.north, vest.estimator.out.east);
    check_inside(vest.controller.state.base_north, vest.controller.state.base_east);
    check_place(&vest.radio.mission.home, vest.controller.state.base_north, vest.controller.state.base_east);
    for (int32_t i = 0; i < vest.controller.state.count; i++) {
        check_inside(vest.controller.state.route_north[i], vest.controller.state.route_east[i]);
        check_place(&vest.radio.mission.waypoints[i], vest.controller.state.route_north[i],
                    vest.controller.state.route_east[i]);
    }
    check_leg(vest.estimator.out.north, vest.estimator.out.east, vest.controller.state.route_north[0],
              vest.controller.state.route_east[0]);
    for (int32_t i = 1; i < vest.controller.state.count; i++) {
        check_leg(vest.controller.state.route_north[i - 1], vest.controller.state.route_east[i - 1],
                  vest.controller.state.route_north[i], vest.controller.state.route_east[i]);
    }
}

static void check_vest(void)
{
    static const uint16_t tones[6] = {0U, 1500U, 3500U, 9500U, 0U, 0U};
    const int32_t command = vest.controller.out.command;

    assert(world.tone == tones[command]);
    assert(world.left == (command == CMEC_COMMAND_LEFT));
    assert(world.right == (command == CMEC_COMMAND_RIGHT));
}

/* A u16 is the nearest to a value, or its own greatest. */
static void check_sent(const uint8_t *bytes, double value)
{
    const double sent = (double)(((unsigned)bytes[0] << 8) | bytes[1]);

    assert(fabs(sent - fmin(value, 65535.0)) <= 0.51);
}

static void check_telemetry(void)
{
    const uint8_t *const t = world.telemetry;

    assert(world.reports <= 1U);
    world.due = world.due || ((world.ticks % REPORT_TICKS) == 0U);
    if (world.due && (vest.busy || vest.watchdog.in.heard) && (world.late < 2U)) { /* a fix or a message goes first */
        world.late++;
        assert(world.reports == 0U);
    } else {
        assert(world.reports == (world.due ? 1U : 0U));
    }
    if (world.reports == 1U) {
        world.due = false;
        world.late = 0U;
        assert((t[0] == 0xA5U) && (t[1] == 0x5AU) && (t[2] == 16U) && (t[3] == TELEMETRY_SIZE));
        assert(signed_intact(t) && signed_genuine(t) && (signed_counter(t) == (world.told + 1U)));
        world.told++;
        check_sent(&t[AT_POSITION_SD], 100.0 * fmax((double)vest.estimator.out.north_sd, (double)vest.estimator.out.east_sd));
        check_sent(&t[AT_SPEED_SD], 100.0 * (double)vest.estimator.out.speed_sd);
        check_sent(&t[AT_DISTANCE], 10.0 * (double)vest.controller.out.distance);
        assert(t[AT_COMMAND] == (uint8_t)vest.controller.out.command);
        assert(((t[AT_FLAGS] & 1U) != 0U) == vest.estimator.out.valid);
        assert(((t[AT_FLAGS] & 4U) != 0U) == (world.silence <= LONGEST_SILENCE));
        assert(((t[AT_READY + 3U] & 1U) != 0U) == (world.silence <= LONGEST_SILENCE));
        assert(((t[AT_READY + 3U] & 2U) != 0U) == (world.imu_silence <= LONGEST_IMU_SILENCE));
        assert(((t[AT_READY + 3U] & 0x20U) != 0U) == (vest.radio.mission.count > 0U));
        assert(((t[AT_READY + 2U] & 8U) != 0U) == (vest.place > (vest.radio.mission.corners + vest.radio.mission.count)));
        assert(((t[AT_READY + 2U] & 2U) != 0U) == !overridden());
        assert(((t[AT_READY + 2U] & 4U) != 0U) == (vest.controller.out.mode == CMEC_MODE_IDLE));
        assert((t[AT_READY] == 0U) && ((t[AT_READY + 1U] & ~4U) == 3U)); /* battery and temperature, not told */
        assert(((t[AT_READY + 1U] & 4U) == 0U) == world.rejecting);
        assert((t[AT_BATTERY] == 0U) && (t[AT_BATTERY + 1U] == 0U));
        assert((t[AT_TEMPERATURE] == 0x80U) && (t[AT_TEMPERATURE + 1U] == 0U));
        assert(((t[AT_READY + 2U] & 0x10U) != 0U) == !world.contradicted);
    }
}

static uint32_t messages(void)
{
    return accepted() - vest.radio.refused - vest.radio.unknown;
}

static void tick(void)
{
    const uint32_t heard = messages();
    const uint32_t accepted_before = accepted();
    const uint32_t received = vest.radio.received;
    const bool waited = vest.busy;
    const int32_t bad_samples = vest.estimator.state.bad_samples;
    const uint32_t sampled = vest.imu.scanner.frames;
    const bool started = vest.controller.in.start;
    const int32_t mode = vest.controller.out.mode;
    const link_mission mission = vest.radio.mission;

    walk();
    give();
    memset(world.taken, 0, sizeof(world.taken));
    world.reports = 0U;
    onboard_tick(&vest);
    world.silence = (messages() != heard) ? 0U : (world.silence + 1U);
    follow_override(accepted_before, received);
    if (world.silence > LONGEST_SILENCE) {
        world.override = 0U;
    }
    assert(!vest.watchdog.in.overridden || (world.silence == 0U));
    world.imu_silence = vest.watchdog.in.sampled ? 0U : (world.imu_silence + 1U);
    assert(!vest.watchdog.in.sampled || /* a sample has come, and the estimator took it */
           ((vest.imu.scanner.frames != sampled) && (vest.estimator.state.bad_samples == bad_samples)));
    for (unsigned i = 0U; i < (unsigned)PORT_SOURCES; i++) {
        assert(world.taken[i] <= (ONBOARD_BLOCKS * PORT_MOST));
    }
    judge_instruments();
    check_declared(&vest);
    modes |= 1U << (unsigned)vest.controller.out.mode;
    check_estimate();
    check_command();
    check_vest();
    if (vest.controller.in.start && !started) {
        check_begun(mode);
    }
    if (vest.controller.in.start && started) { /* what is held is what is led */
        assert(memcmp(&mission, &vest.radio.mission, sizeof(mission)) == 0);
    }
    check_held();
    check_accepted(accepted_before, received);
    check_telemetry();
    assert(vest.busy == (vest.estimator.in.gps_fix && !waited)); /* radio and telemetry wait for one tick at most */
    world.ticks++;
    assert(vest.time_ms == (world.ticks * ONBOARD_TICK_MS));
}

static void obey_order(uint8_t order)
{
    unsigned n = 0U;

    switch (order % (unsigned)ORDERS) {
    case RAW:
        order_raw();
        break;
    case NAV:
        order_nav();
        break;
    case FIX:
        order_fix();
        break;
    case SAMPLE: {
        const uint32_t accel = next_u32();
        const uint32_t pitch = next_u32();

        send_sample(accel, pitch, next_u32());
        break;
    }
    case MESSAGE:
        order_message();
        break;
    case MISSION:
        order_mission();
        break;
    case START:
        order_start();
        break;
    case DAMAGE:
        order_damage();
        break;
    case BACKGROUND:
        order_background();
        break;
    case FORGED:
        order_forged();
        break;
    case REPLAY:
        order_replay();
        break;
    case MOST:
        world.most = (uint16_t)(1U + (2U * next_u8()));
        break;
    case TICKS:
        n = 10U * next_u8();
        break;
    default:
        n = 1U;
        break;
    }
    for (; (n > 0U) && (world.ticks < MOST_TICKS); n--) {
        tick();
    }
}

uint32_t fuzz_modes(void)
{
    return modes;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    orders.data = data;
    orders.left = size;
    memset(&world, 0, sizeof(world));
    world.latitude = 326.0e6;
    world.longitude = -854.9e6;
    world.most = PORT_MOST;
    world.silence = LONGEST_SILENCE;
    world.imu_silence = LONGEST_IMU_SILENCE;
    world.override_age = LONGEST_OVERRIDE;
    modes = 0U;
    onboard_init(&vest);
    while ((orders.left > 0U) && (world.ticks < MOST_TICKS)) {
        obey_order(next_u8());
    }
    return 0;
}
