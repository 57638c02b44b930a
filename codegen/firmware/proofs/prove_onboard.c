/* The conversions of onboard.c: for every float but NaN, and every whole number. */
#include "onboard.h"

/* The calls of is_inside give any answer, but one for the animal. The pasted name tells them, whose first argument is
 * `m`, from the definition. */
#define is_inside(m, north, east) INSIDE_OF_##m, north, east)
#define INSIDE_OF_const shipped_is_inside(const
#define INSIDE_OF_m any_inside(m
static bool any_inside(const onboard *m, float north, float east);
#include "onboard.c"
#undef is_inside

#include "proof.h"

void prove_conversions(void)
{
    const float value = nondet_float();
    const int16_t number = nondet_i16();
    const uint32_t count = nondet_u32();

    __CPROVER_assume(!__CPROVER_isnanf(value)); /* the values are finite: prove_four_state.c, prove_cmec.c */
    assert((value > -32768.0F) || (to_i16(value) == INT16_MIN));
    assert((value < 32767.0F) || (to_i16(value) == INT16_MAX));
    assert((value > 0.0F) || (to_u16(value) == 0U));
    assert((value < 65535.0F) || (to_u16(value) == UINT16_MAX));
    assert((whole(value, -MAX_SHIFT, MAX_SHIFT) >= -MAX_SHIFT) && (whole(value, -MAX_SHIFT, MAX_SHIFT) <= MAX_SHIFT));
    assert((number < 0) || (to_u8(number) == ((number > 255) ? 255 : number)));
    assert(at_most_u16(count) == ((count > 65535U) ? 65535U : count));
    assert(low_word(count) == (count % 65536U));
}

/* The nearest, within one half. */
void prove_nearest(void)
{
    const float value = float_in(-32768.0F, 32767.0F);
    const float error = (float)to_i16(value) - value;

    assert((error >= -0.501F) && (error <= 0.501F));
}

/* A place and a shift from it: on earth, and the same place. No sum overflows: --signed-overflow-check. */
void prove_position(void)
{
    const int32_t shift = int_in(-MAX_SHIFT, MAX_SHIFT);
    const int32_t north = int_in(-QUARTER, QUARTER) + shift;
    const int32_t east = int_in(-HALF, HALF) + int_in(-MAX_SHIFT, MAX_SHIFT);
    const bool beyond = (north > QUARTER) || (north < -QUARTER);
    int32_t latitude = north;
    int32_t longitude = east;
    int64_t turned;

    keep_on_earth(&latitude, &longitude);
    turned = (int64_t)longitude - east;
    assert((latitude >= -QUARTER) && (latitude <= QUARTER));
    assert((longitude >= -HALF) && (longitude <= HALF));
    if (beyond) {
        assert(((int64_t)latitude + north) == ((north > 0) ? HALF : -HALF));
        assert((turned == HALF) || (turned == -HALF));
    } else {
        assert(latitude == north);
        assert((turned == 0) || (turned == (2LL * HALF)) || (turned == (-2LL * HALF)));
        assert((turned == 0) || (east > HALF) || (east < -HALF));
    }
}

/* Any place on the plane or off it: prove_local_plane.c. */
void local_plane_step(local_plane *m)
{
    m->out.north = nondet_float();
    m->out.east = nondet_float();
}

static bool animal_inside;

static bool any_inside(const onboard *m, float north, float east)
{
    const bool animal = (north == m->estimator.out.north) && (east == m->estimator.out.east);

    return animal ? animal_inside : nondet_bool();
}

/* Rule 8: a trial begins only by a START for the mission held, with everything that it needs. */
void prove_begin(void)
{
    onboard m;

    animal_inside = nondet_bool();
    m.estimator.out.north = float_in(-1.0e5F, 1.0e5F);
    m.estimator.out.east = float_in(-1.0e5F, 1.0e5F);
    m.asked = nondet_bool();
    m.planned = nondet_bool();
    m.busy = nondet_bool();
    m.watchdog.in.heard = nondet_bool();
    m.controller.in.start = nondet_bool();
    m.watchdog.out.link_ok = nondet_bool();
    m.watchdog.out.imu_ok = nondet_bool();
    m.watchdog.out.estimate_ok = nondet_bool();
    m.watchdog.out.override_ok = nondet_bool();
    m.local_plane.state.settled = nondet_bool();
    m.estimator.out.heading_ok = nondet_bool();
    m.controller.par.capture_radius = 7.0F;
    m.controller.par.guarded = true;
    m.controller.par.window_issues = 40;
    m.controller.par.window_vibration = 80.0F;
    m.controller.par.window_tone = 240.0F;
    m.controller.mission.waypoint_north[0] = float_in(-1.0e5F, 1.0e5F);
    m.controller.mission.waypoint_east[0] = float_in(-1.0e5F, 1.0e5F);
    __CPROVER_assume((m.radio.mission.count <= LINK_MAX_WAYPOINTS) && (m.radio.mission.corners <= LINK_MAX_CORNERS));
    __CPROVER_assume((m.route & ~(READY_REACH | READY_LEGS | READY_FENCE)) == 0);
    __CPROVER_assume(m.planned == (m.place > (m.radio.mission.corners + m.radio.mission.count))); /* one by one */
    for (int i = 0; i < 3; i++) { /* what was spent grows */
        m.controller.state.earlier_spent[i] = int_in(0, 2000000000);
        m.controller.state.spent[i] = int_in(m.controller.state.earlier_spent[i], 2000000000);
    }
    const bool before = m.controller.in.start;
    const bool asked = m.asked;
    begin(&m);
    assert(!m.asked && (!before || m.controller.in.start));
    assert(m.planned == (m.place > (m.radio.mission.corners + m.radio.mission.count)));
    if (m.controller.in.start && !before) {
        assert(m.route == (READY_REACH | READY_LEGS | READY_FENCE));
        assert(animal_inside);
        assert(asked && (m.radio.mission.count > 0U) && (m.radio.asked == m.radio.mission.id));
        assert(m.watchdog.out.link_ok && m.watchdog.out.imu_ok && m.watchdog.out.estimate_ok);
        assert(m.local_plane.state.settled && m.planned && (m.controller.out.mode == CMEC_MODE_IDLE));
        assert((m.radio.override == 0U) ||
               (!m.watchdog.out.override_ok && (m.radio.override != (uint8_t)CMEC_COMMAND_STOP)));
        assert(m.estimator.state.rejected == 0);
        assert(m.estimator.out.heading_ok && (m.gps.fix.h_acc <= 7000U));
        assert((fabsf(m.controller.mission.waypoint_north[0] - m.estimator.out.north) > 4.9F) ||
               (fabsf(m.controller.mission.waypoint_east[0] - m.estimator.out.east) > 4.9F)); /* 7 m in all */
        assert((m.controller.state.spent[0] - m.controller.state.earlier_spent[0]) < 40);
        assert((m.controller.state.spent[1] - m.controller.state.earlier_spent[1]) < 2000); /* ticks: 80 s */
        assert((m.controller.state.spent[2] - m.controller.state.earlier_spent[2]) < 6000);
        assert((m.battery_mv == 0U) || (m.battery_mv >= ONBOARD_LEAST_BATTERY_MV));
        assert((m.temperature == PORT_NO_TEMPERATURE) ||
               ((m.temperature >= ONBOARD_LEAST_TEMPERATURE) && (m.temperature <= ONBOARD_MOST_TEMPERATURE)));
    }
}
