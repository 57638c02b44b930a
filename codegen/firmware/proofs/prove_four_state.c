/* The estimator's parts, from any state within bounds that are far wider than in trials: no NaN, no
 * infinity, no
 * division by zero, and variances stay positive. */
#include "four_state.c"

#include "proof.h"
#include "shipped.h"

float sqrtf(float x)
{
    const float root = nondet_float();

    assert(x >= 0.0F);
    __CPROVER_assume((root >= 0.0F) && (root <= 1.0e19F));
    return root;
}

static four_state any_state(void)
{
    four_state m;

    four_state_defaults(&m);
    m.par = shipped().estimator.par;
    m.state.started = true;
    for (int i = 0; i < 4; i++) {
        m.state.x[i] = float_in(-1.0e6F, 1.0e6F);
    }
    m.state.acceleration = float_in(-300.0F, 300.0F);
    m.state.held_heading = float_in(-7.0F, 7.0F);
    m.state.held_heading_sd = float_in(0.0F, 2.0F);
    m.state.sigma = float_in(0.01F, 200.0F);
    m.state.age = int_in(0, 2000000000);
    m.state.bad_samples = int_in(0, 2000000000);
    m.state.bad_fixes = int_in(0, 2000000000);
    m.state.rejected = short_in(0, 1000);
    return m;
}

/* Any bits as sample: a bad one is not taken. */
void prove_listen(void)
{
    four_state m = any_state();

    m.in.accel_x = nondet_float();
    m.in.pitch_meas = nondet_float();
    m.in.heading_meas = nondet_float();
    m.state.x[1] = float_in(-200.0F, 200.0F);
    four_state_listen(&m);
    assert((m.state.acceleration >= -300.0F) && (m.state.acceleration <= 300.0F));
    assert((m.state.held_heading >= -7.0F) && (m.state.held_heading <= 7.0F));
}

/* Rule 6: a sample is taken only from a sensor that has told something new within `frozen_samples` ticks. */
void prove_silent(void)
{
    four_state m = any_state();
    const float bias = m.state.x[1];

    m.state.silence = short_in(0, 30000);
    m.state.sample_sum = float_in(-300.0F, 300.0F);
    m.in.accel_x = nondet_float();
    m.in.pitch_meas = nondet_float();
    m.in.heading_meas = nondet_float();
    const int16_t silence = m.state.silence;
    const float last = m.state.sample_sum;
    const float heading = m.state.held_heading;
    const float sum = (m.in.accel_x + m.in.pitch_meas) + m.in.heading_meas;
    const bool in_range = (fabsf(m.in.accel_x) <= 200.0F) && (fabsf(m.in.pitch_meas) <= 4.0F) &&
                          (fabsf(m.in.heading_meas) <= 7.0F);

    four_state_listen(&m);
    if (in_range && (sum != last)) {
        assert(m.state.silence == 0);
    } else {
        assert(m.state.silence == ((silence < 30000) ? (silence + 1) : 30000));
    }
    if (m.state.silence > m.par.frozen_samples) {
        assert((m.state.acceleration == bias) && (m.state.held_heading == heading));
    }
}

/* Rule 6: courses that contradict the heading for `heading_time` are noticed; it is taken back when as many agree.
 * The course turns from the heading by no more than a turn. */
void prove_confront(void)
{
    four_state m = any_state();
    const float turn = float_in(-6.5F, 6.5F);
    float off;

    m.state.fix_gap = int_in(1, 2000000000);
    m.state.contradiction = float_in(0.0F, 3.0F);
    m.state.contradicted = nondet_bool();
    m.state.held_heading = 0.0F;
    m.in.gps_course = turn;
    const four_state before = m;

    off = fabsf(turn);
    off = (off > 3.1415927F) ? fabsf(6.2831853F - off) : off;
    four_state_confront(&m);
    assert((m.state.contradiction >= 0.0F) && (m.state.contradiction <= m.par.heading_time));
    if (off > 0.7855F) { /* 45 deg, but for rounding */
        assert(m.state.contradiction >= before.state.contradiction);
        assert((m.state.contradiction == m.par.heading_time) ||
               (m.state.contradiction >= (before.state.contradiction + 0.0399F)));
        assert(!before.state.contradicted || m.state.contradicted);
    } else if (off < 0.7853F) {
        assert((m.state.contradiction == 0.0F) ||
               (m.state.contradiction <= (before.state.contradiction - 0.0399F)));
        assert((before.state.contradicted && (m.state.contradiction > 0.0F)) || !m.state.contradicted ||
               (m.state.contradiction >= m.par.heading_time));
    } else {
        /* either */
    }
    assert(m.state.contradicted || (m.state.contradiction < m.par.heading_time));
    assert(!m.state.contradicted || (m.state.contradiction > 0.0F));
}

void prove_tune(void)
{
    four_state m = any_state();

    if (fabsf(m.state.x[0]) < 3.0F) {
        four_state_tune_walking(&m);
    } else {
        four_state_tune_running(&m);
    }
    assert((m.state.sigma >= 0.01F) && (m.state.sigma <= 200.0F));
}

void prove_judge(void)
{
    four_state m = any_state();

    /* every value that onboard.c can give: 1e-7 deg times metres in it; a u32 of mm; ubx.c's range of speeds */
    m.state.rejections = 7;
    m.in.gps_north = float_in(-2.1e7F, 2.1e7F);
    m.in.gps_east = float_in(-2.1e7F, 2.1e7F);
    m.in.gps_speed = float_in(0.0F, 515.0F);
    m.in.gps_h_acc = float_in(0.0F, 4.3e6F);
    m.in.gps_s_acc = float_in(0.0F, 4.3e6F);
    four_state_judge(&m);
    assert(m.state.good == ((fabsf(m.in.gps_north) <= 1.0e5F) && (fabsf(m.in.gps_east) <= 1.0e5F) &&
                            (m.in.gps_speed <= 50.0F) && (m.in.gps_h_acc >= 0.001F) && (m.in.gps_h_acc <= 1000.0F) &&
                            (m.in.gps_s_acc >= 0.001F) && (m.in.gps_s_acc <= 100.0F)));
    assert(!m.state.accepted || (m.state.good && m.state.started));
    assert(m.state.rejections == ((m.state.good && !m.state.accepted && m.state.started) ? 8 : 7)); /* rule 5 */
}

static void any_covariance(four_state *m)
{
    for (int i = 0; i < 4; i++) {
        m->state.covariance[i] = float_in(1.0e-12F, 1.0e9F);
    }
    for (int i = 4; i < 10; i++) {
        m->state.covariance[i] = float_in(-1.0e4F, 1.0e4F);
    }
}

void prove_output(void)
{
    four_state m = any_state();

    any_covariance(&m);
    m.state.started = nondet_bool();
    m.state.contradicted = nondet_bool();
    m.state.silence = short_in(0, 30000);
    four_state_output(&m);
    if (m.out.valid) { /* rule 5 */
        assert(m.state.started && (m.state.age <= (int32_t)((25.0 * (double)m.par.max_age) + 0.1)));
        assert((m.out.north_sd <= m.par.max_position_sd) && (m.out.east_sd <= m.par.max_position_sd));
        assert((m.out.speed_sd <= m.par.max_speed_sd) && (m.out.heading_sd <= m.par.max_heading_sd));
        assert(!m.state.contradicted && (m.state.silence <= m.par.frozen_samples)); /* rule 6 */
    }
    assert((m.out.heading >= -3.1415930F) && (m.out.heading <= 3.1415930F));
}
