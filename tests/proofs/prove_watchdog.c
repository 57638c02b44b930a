/* From any state: the ages stop at their greatest value, and silence is found on its tick. */
#include "watchdog.c"

#include "proof.h"
#include "shipped.h"

void prove_step(void)
{
    watchdog m;

    watchdog_defaults(&m);
    m.par = shipped().watchdog.par;
    watchdog_initialize(&m);
    m.state.imu_age = short_in(0, 30000);
    m.state.link_age = short_in(0, 30000);
    m.state.override_age = short_in(0, 30000);
    m.state.report_age = short_in(0, 30000);
    m.in.sampled = nondet_bool();
    m.in.heard = nondet_bool();
    m.in.overridden = nondet_bool();
    m.in.valid = nondet_bool();
    watchdog_step(&m);
    assert((m.state.imu_age >= 0) && (m.state.imu_age <= 30000));
    assert((m.state.link_age >= 0) && (m.state.link_age <= 30000));
    assert((m.state.override_age >= 0) && (m.state.override_age <= 30000));
    assert((m.state.report_age >= 0) && (m.state.report_age <= 30000));
    assert(m.out.link_ok == (m.state.link_age <= 50));  /* 2 s of 40 ms */
    assert(m.out.imu_ok == (m.state.imu_age <= 5));     /* 0.2 s */
    assert(m.out.override_ok == (m.state.override_age <= 25)); /* 1 s */
    assert(m.out.estimate_ok == (m.in.valid && m.out.imu_ok));
    assert(m.out.report == (m.state.report_age == 0));
}
