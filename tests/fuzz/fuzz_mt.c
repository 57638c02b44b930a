/* Arbitrary bytes in arbitrary blocks through the inertial unit's parser, in z-up and z-down axes.
 * Every byte is in a frame, skipped or held; the axes differ only by signs, and NaN and infinity become the
 * greatest float. */
#include "mt.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static bool opposite(float a, float b)
{
    uint32_t bits[2];

    memcpy(&bits[0], &a, sizeof(a));
    memcpy(&bits[1], &b, sizeof(b));
    return ((bits[0] ^ bits[1]) == 0x80000000U) || ((bits[0] == 0x7F7FFFFFU) && (bits[1] == bits[0]));
}

static void check_axes(const mt *up, const mt *down)
{
    for (mt_quantity q = MT_ACCEL_X; q <= MT_HEADING; q++) {
        const float a = mt_value(up, q);
        const float b = mt_value(down, q);

        assert(isfinite(a));
        assert((memcmp(&a, &b, sizeof(a)) == 0) || opposite(a, b));
    }
    assert(opposite(mt_value(up, MT_ACCEL_Y), mt_value(down, MT_ACCEL_Y)));
    assert(up->counter == down->counter);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    mt up;
    mt down;
    size_t at = 1U;
    const size_t block = (size > 0U) ? (1U + (size_t)data[0]) : 1U;

    mt_init(&up, true);
    mt_init(&down, false);
    while (at < size) {
        const size_t n = (block < (size - at)) ? block : (size - at);
        uint8_t *const copy = malloc(n); /* of exactly its size, so that reading beyond it is found */
        scanner_input to_up = {copy, (uint16_t)n};
        scanner_input to_down = to_up;

        memcpy(copy, &data[at], n);
        while (mt_receive(&up, &to_up)) {
            assert(mt_receive(&down, &to_down));
            assert((up.scanner.length == 55U) && (((uint16_t)up.scanner.start + up.scanner.count) <= SCANNER_SIZE));
            check_axes(&up, &down);
        }
        assert(!mt_receive(&down, &to_down));
        assert((to_up.count == 0U) && (to_down.count == 0U));
        assert((up.scanner.frame == NULL) && (up.scanner.count < SCANNER_SIZE));
        free(copy);
        at += n;
        assert(((55U * up.scanner.frames) + up.scanner.skipped + up.scanner.count) == (at - 1U));
    }
    return 0;
}
