/* The conversions of onboard.c: for every float but NaN, and every whole number. */
#include "onboard.c"

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
