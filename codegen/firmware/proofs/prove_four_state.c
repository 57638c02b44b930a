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
    four_state_output(&m);
    if (m.out.valid) { /* rule 5 */
        assert(m.state.started && (m.state.age <= (int32_t)((25.0 * (double)m.par.max_age) + 0.1)));
        assert((m.out.north_sd <= m.par.max_position_sd) && (m.out.east_sd <= m.par.max_position_sd));
        assert(m.out.speed_sd <= m.par.max_speed_sd);
    }
    assert((m.out.heading >= -3.1415930F) && (m.out.heading <= 3.1415930F));
}
