/* Rule 7: the polygon. What a survey finds is any limit: those of rules 4 and 7 are proved apart. */
#define ANY_SURVEY
#include "controller.h"

/* Is the animal east of all corners of the polygon, or west of all? Then no edge is north of it. */
static bool beside_all(const cmec *m, float east)
{
    bool beyond = true;
    bool before = true;

    for (int i = 0; i < m->state.corners; i++) {
        beyond = beyond && (east > m->state.corner_east[i]);
        before = before && (east < m->state.corner_east[i]);
    }
    return (m->state.corners > 0) && (beyond || before);
}

/* The edge looked at last ends in its corner; what is counted is counted in a trial. */
static bool in_turn(const cmec *m, int32_t outside)
{
    const int32_t last = (m->state.edge > 0) ? m->state.edge : m->state.corners;

    return ((last == 0) || (m->state.edge_east[1] == m->state.corner_east[last - 1])) &&
           ((outside == 0) || m->state.led);
}

/* The animal has been outside for so many ticks: since its place was noted, or its place was noted outside, and no
 * edge has been found to its north. */
static bool noticed(const cmec *m, int32_t outside)
{
    const int32_t since = (m->state.edge > 0) ? m->state.edge : m->state.corners;

    return (outside == 0) || (outside < since) ||
           ((m->state.edge > 0) && (outside < (m->state.corners + m->state.edge)) && !m->state.inside &&
            beside_all(m, m->state.place_east));
}

/* An animal that leaves the polygon to the east or west, beyond all of its n corners, is stopped before the estimate
 * has been outside on 2n - 1 ticks. */
void prove_polygon(void)
{
    cmec m = any_controller(true);
    int32_t outside = int_in(0, MOST); /* ticks */

    __CPROVER_assume(in_turn(&m, outside) && noticed(&m, outside));
    cmec_step(&m);
    outside = (going(m.out.mode) && m.in.valid && !bad(&m) && beside_all(&m, m.in.east)) ? (outside + 1) : 0;
    assert(in_turn(&m, outside));
    assert(noticed(&m, outside));
    assert((outside == 0) || (outside < ((2 * m.state.corners) - 1)));
}
