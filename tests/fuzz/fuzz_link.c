/* Arbitrary bytes in arbitrary blocks, with pauses, through the radio's parser.
 * Every byte is in a frame, skipped or held; no ABORT is held (rule 10); a mission is within its ranges; a
 * message has the values of its type and changes no others, its tag is right and its counter grew (rule 11);
 * every frame is counted once. Of the frames in the bytes, some get a right CRC, some a right tag too. */
#include "link.h"
#include "signed.h"

#include <assert.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *input_data, size_t size);

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

/* Rule 11: what acts was signed, is new, and answers a telemetry that was told and, but for an ABORT, lately. */
static void check_signed(link_message message, const radio_link *before, const radio_link *m)
{
    if (message != LINK_NOTHING) {
        const uint8_t *const frame = m->scanner.frame;
        const uint32_t counter = signed_counter(frame);
        const uint32_t answered = counter / 256U;

        assert(signed_genuine(frame) && (frame[2] == (uint8_t)message));
        assert((counter > before->received) && (counter == m->received));
        assert((answered <= m->told) && ((message == LINK_ABORT) || ((m->told - answered) <= 15U)));
    }
    assert(m->received >= before->received);
    assert((message == LINK_HEARTBEAT) || (before->nonce == m->nonce));
    assert((m->session == before->session) && (m->told == before->told));
}

static uint32_t judged(const radio_link *m)
{
    return m->forged + m->replayed + m->refused + m->unknown;
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

static void check_held(const scanner *s)
{
    for (unsigned i = 0U; (i + SIGNED_OVERHEAD) <= s->count; i++) {
        assert(!signed_abort(&s->bytes[s->start + i]));
    }
}

/* Make frames of what looks so, by two bits of their last byte: right CRC, right tag. */
static void mend(uint8_t *bytes, size_t n)
{
    for (size_t i = 0U; (i + SIGNED_OVERHEAD) <= n; i++) {
        uint8_t *const f = &bytes[i];
        const size_t end = i + SIGNED_OVERHEAD + f[3];

        if ((f[0] == 0xA5U) && (f[1] == 0x5AU) && (end <= n) && ((bytes[end - 1U] & 3U) != 0U)) {
            signed_finish(f, (bytes[end - 1U] & 2U) != 0U);
            i = end - 1U;
        }
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *input_data, size_t size)
{
    radio_link m;
    size_t at = 2U;
    uint32_t messages = 0U;
    uint8_t *const data = malloc(size + 1U);
    const size_t block = (size > 0U) ? (1U + (size_t)input_data[0]) : 1U;

    memcpy(data, input_data, size);
    if (size > at) {
        mend(&data[at], size - at);
    }
    link_init(&m, SIGNED_SESSION);
    m.told = (size > 1U) ? input_data[1] : 0U;
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
            check_signed(message, &before, &m);
            messages += (message != LINK_NOTHING) ? 1U : 0U;
            assert(m.scanner.frames == (messages + judged(&m)));
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
                messages++;
            }
        }
        free(copy);
        at += n;
        assert((m.scanner.skipped + m.scanner.count) <= (at - 2U));
    }
    free(data);
    return 0;
}
