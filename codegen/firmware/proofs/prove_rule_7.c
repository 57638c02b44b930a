/* Rule 7: the fence. */
#include "controller.h"

/* An animal that is farther from home than the fence, to the north, south, east or west, is stopped within 0.2 s. The
 * metre more leaves room for rounding. */
void prove_radius(void)
{
    cmec m = any_controller(true);
    int32_t outside = int_in(0, MOST); /* ticks */
    bool far;

    __CPROVER_assume((outside == 0) || (outside <= m.state.survey_ticks));
    cmec_step(&m);
    far = (fabsf(m.in.north - m.state.base_north) > (m.par.fence_radius + 1.0F)) ||
          (fabsf(m.in.east - m.state.base_east) > (m.par.fence_radius + 1.0F));
    outside = (going(m.out.mode) && m.in.valid && !bad(&m) && far) ? (outside + 1) : 0;
    assert((outside == 0) || (outside <= m.state.survey_ticks));
    assert(outside < 5);
}
