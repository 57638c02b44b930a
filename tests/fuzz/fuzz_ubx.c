/* Arbitrary bytes in arbitrary blocks through the receiver's parser.
 * Every byte is in a frame, skipped or held; a fix is within its ranges; no two in a row have the same time. */
#include "ubx.h"

#include <assert.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check_fix(const ubx_fix *fix)
{
    assert(abs(fix->latitude) <= 900000000);
    assert(abs(fix->longitude) <= 1800000000);
    assert(abs(fix->course) <= 36000000);
    assert(fix->speed <= 515000U);
    assert((fix->h_acc > 0U) && (fix->s_acc > 0U));
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    ubx m;
    size_t framed = 0U;
    size_t at = 1U;
    const size_t block = (size > 0U) ? (1U + (size_t)data[0]) : 1U;

    ubx_init(&m);
    while (at < size) {
        const size_t n = (block < (size - at)) ? block : (size - at);
        uint8_t *const copy = malloc(n); /* of exactly its size, so that reading beyond it is found */
        scanner_input input = {copy, (uint16_t)n};
        ubx_fix last = m.fix;
        bool fixed = m.fixed;
        ubx_event event;

        memcpy(copy, &data[at], n);
        for (event = ubx_receive(&m, &input); event != UBX_NOTHING; event = ubx_receive(&m, &input)) {
            assert(((uint16_t)m.scanner.start + m.scanner.count) <= SCANNER_SIZE);
            framed += m.scanner.length;
            if (event == UBX_FIX) {
                check_fix(&m.fix);
                assert(!fixed || (last.time_ms != m.fix.time_ms));
                last = m.fix;
                fixed = true;
            } else {
                assert(memcmp(&last, &m.fix, sizeof(last)) == 0);
            }
        }
        assert(input.count == 0U);
        assert((m.scanner.frame == NULL) && (m.scanner.count < SCANNER_SIZE));
        free(copy);
        at += n;
        assert((framed + m.scanner.skipped + m.scanner.count) == (at - 1U));
    }
    return 0;
}
