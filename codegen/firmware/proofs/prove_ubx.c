/* The receiver's frames, with any bytes: no access beyond them, and a fix is within its ranges. */
#include "ubx.c"

#include "proof.h"

/* Finds any frame of the protocol's length, or none: prove_scanner.c proves this of the scanner. */
bool scanner_next(scanner *s, scanner_input *input, const scanner_protocol *protocol)
{
    static uint8_t frame[SCANNER_SIZE];

    (void)input;
    __CPROVER_havoc_object(frame);
    s->frame = frame;
    s->length = protocol->length(frame);
    return (s->length != 0U) && nondet_bool();
}

void scanner_count(uint32_t *counter, uint16_t more)
{
    *counter = (*counter > (UINT32_MAX - more)) ? UINT32_MAX : (*counter + more);
}

void prove_length(void)
{
    uint8_t header[HEADER];
    const uint8_t length = ubx_length(header);

    assert((length == 0U) || ((length >= HEADER) && (length <= SCANNER_SIZE)));
}

void prove_intact(void)
{
    uint8_t frame[100]; /* the longest */
    const uint8_t length = nondet_u8();

    __CPROVER_assume((length == 36U) || (length == 44U) || (length == 60U) || (length == 92U) ||
                     (length == 100U));
    (void)ubx_intact(frame, length);
}

/* Does the receiver call the position good: 3D, or with dead reckoning, within its limits and not held in doubt? */
static bool calls_good(const uint8_t *frame, uint8_t length, bool before)
{
    const uint8_t *const payload = &frame[6];
    bool good = before;

    if (frame[3] == 0x06U) { /* NAV-SOL: gpsFix, flags */
        good = ((payload[10] == 3U) || (payload[10] == 4U)) && ((payload[11] % 2U) == 1U);
    } else if (frame[3] == 0x07U) { /* NAV-PVT: fixType, flags; valid; in the longer one flags3 */
        good = ((payload[20] == 3U) || (payload[20] == 4U)) && ((payload[21] % 2U) == 1U) &&
               (((payload[11] / 2U) % 2U) == 1U) && ((length < 100U) || ((payload[78] % 2U) == 0U));
    } else {
        /* a part of an epoch */
    }
    return good;
}

/* NAV-SOL alone, and every one, tells whether the parts of an epoch are good. */
void prove_good(void)
{
    ubx m;
    scanner_input input;

    m.good = nondet_bool();
    const bool before = m.good;
    if (ubx_receive(&m, &input) != UBX_NOTHING) {
        assert(m.good == ((m.scanner.frame[3] == 0x07U) ? before : calls_good(m.scanner.frame, m.scanner.length, before)));
    } else {
        assert(m.good == before);
    }
}

void prove_receive(void)
{
    ubx m; /* any state */
    scanner_input input;
    const bool fixed = m.fixed;
    const uint32_t before = m.fix.time_ms;
    const bool good = m.good; /* of the last NAV-SOL */

    if (ubx_receive(&m, &input) == UBX_FIX) {
        assert(calls_good(m.scanner.frame, m.scanner.length, good));
        assert((m.fix.latitude >= -900000000) && (m.fix.latitude <= 900000000));
        assert((m.fix.longitude >= -1800000000) && (m.fix.longitude <= 1800000000));
        assert((m.fix.course >= -36000000) && (m.fix.course <= 36000000));
        assert((m.fix.speed <= 515000U) && (m.fix.h_acc > 0U) && (m.fix.s_acc > 0U));
        assert(!fixed || (m.fix.time_ms != before));
        assert(m.fixed);
    }
}
