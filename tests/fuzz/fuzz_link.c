/* Arbitrary bytes in arbitrary blocks, with pauses, through the radio's parser.
 * Every byte is in a frame, skipped or held; no ABORT is held (rule 10); a mission is within its ranges; a
 * message has the values of its type and changes no others. */
#include "link.h"

#include <assert.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void check_position(const link_position *position)
{
    assert(abs(position->latitude) <= 900000000);
    assert(abs(position->longitude) <= 1800000000);
}

static void check_mission(const link_mission *mission)
{
    assert((mission->count >= 1U) && (mission->count <= LINK_MAX_WAYPOINTS));
    check_position(&mission->home);
    for (uint8_t i = 0U; i < mission->count; i++) {
        check_position(&mission->waypoints[i]);
    }
}

static void check_message(link_message message, const radio_link *before, const radio_link *m)
{
    if (message == LINK_MISSION) {
        check_mission(&m->mission);
    } else {
        assert(memcmp(&before->mission, &m->mission, sizeof(m->mission)) == 0);
    }
    assert((message == LINK_START) || (before->asked == m->asked));
    assert((message == LINK_OVERRIDE) || (before->override == m->override));
    assert(m->override <= 5U);
    assert((message >= LINK_NOTHING) && (message <= LINK_HEARTBEAT));
}

static uint16_t crc_ccitt(const uint8_t *bytes, size_t n)
{
    unsigned crc = 0xFFFFU;

    for (size_t i = 0U; i < (8U * n); i++) {
        const unsigned bit = ((unsigned)bytes[i / 8U] >> (7U - (i % 8U))) & 1U;

        crc = ((crc << 1) ^ (((crc >> 15) != bit) ? 0x1021U : 0U)) & 0xFFFFU;
    }
    return (uint16_t)crc;
}

static void check_held(const scanner *s)
{
    for (unsigned i = 0U; (i + 7U) <= s->count; i++) {
        const uint8_t *const f = &s->bytes[s->start + i];
        const bool looks = (f[0] == 0xA5U) && (f[1] == 0x5AU) && (f[2] == 4U) && (f[4] == 0U);

        assert(!looks || (crc_ccitt(&f[2], 3U) != (uint16_t)(((unsigned)f[5] << 8) | f[6])));
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    radio_link m;
    size_t at = 1U;
    const size_t block = (size > 0U) ? (1U + (size_t)data[0]) : 1U;

    link_init(&m);
    while (at < size) {
        const size_t n = (block < (size - at)) ? block : (size - at);
        uint8_t *const copy = malloc(n); /* of exactly its size, so that reading beyond it is found */
        scanner_input input = {copy, (uint16_t)n};
        link_message message;

        memcpy(copy, &data[at], n);
        do {
            const radio_link before = m;

            message = link_receive(&m, &input);
            check_message(message, &before, &m);
            assert(((uint16_t)m.scanner.start + m.scanner.count) <= SCANNER_SIZE);
        } while (message != LINK_NOTHING);
        assert(input.count == 0U);
        check_held(&m.scanner);
        assert((m.scanner.frame == NULL) && (m.scanner.count < SCANNER_SIZE));
        if ((data[at] & 1U) != 0U) {
            scanner_input nothing = {NULL, 0U};

            link_idle(&m);
            while (link_receive(&m, &nothing) != LINK_NOTHING) {
                assert(m.scanner.frame != NULL);
            }
        }
        free(copy);
        at += n;
        assert((m.scanner.skipped + m.scanner.count) <= (at - 1U));
    }
    return 0;
}
