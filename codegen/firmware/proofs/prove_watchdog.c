/* From any state: the ages stop at their greatest value, and silence is found on its tick. */
#include "watchdog.c"

#include "proof.h"
#include "shipped.h"

/* An age behind a tick: it counts up to its greatest value, unless something has arrived. */
static int16_t aged(int16_t age, bool arrived)
{
    return (int16_t)(arrived ? 0 : (age < 30000) ? (age + 1) : 30000);
}

void prove_step(void)
{
    watchdog m;
    watchdog before;

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
    before = m;
    watchdog_step(&m);
    assert(m.state.imu_age == aged(before.state.imu_age, m.in.sampled));
    assert(m.state.link_age == aged(before.state.link_age, m.in.heard));
    assert(m.state.override_age == aged(before.state.override_age, m.in.overridden));
    assert(m.out.report == (before.state.report_age >= 4)); /* every 0.2 s */
    assert(m.state.report_age == aged(before.state.report_age, m.out.report));
    assert(m.out.link_ok == (m.state.link_age <= 50));  /* 2 s of 40 ms */
    assert(m.out.imu_ok == (m.state.imu_age <= 5));     /* 0.2 s */
    assert(m.out.override_ok == (m.state.override_age <= 25)); /* 1 s */
    assert(m.out.estimate_ok == (m.in.valid && m.out.imu_ok));
}
