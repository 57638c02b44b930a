/* Positions anywhere on earth, with an origin anywhere on it. */
#include "local_plane.c"

#include "proof.h"

static local_plane anywhere(void)
{
    local_plane m;

    m.in.latitude = int_in(-900000000, 900000000);
    m.in.longitude = int_in(-1800000000, 1800000000);
    m.state.origin_latitude = int_in(-900000000, 900000000);
    m.state.origin_longitude = int_in(-1800000000, 1800000000);
    m.state.north_scale = float_in(0.0109F, 0.0113F); /* the least and greatest radii of the meridian */
    m.state.east_scale = float_in(1.74e-6F, 0.0112F);
    m.par.least_parallel = 1000.0F;
    return m;
}

void prove_project(void)
{
    local_plane m = anywhere();

    local_plane_project(&m);
    assert((m.out.north >= -2.04e7F) && (m.out.north <= 2.04e7F));
    assert((m.out.east >= -2.02e7F) && (m.out.east <= 2.02e7F)); /* half the equator: the short way round */
}
