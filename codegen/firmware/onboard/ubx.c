/* ubx: position and velocity from a u-blox receiver's binary protocol
 * Source: u-blox 5/6/M8 receiver description including protocol specification, class NAV.
 * A frame: B5 62, class, id, length of the payload (2 bytes), payload, checksum (2). Little-endian. */
#include "ubx.h"

#include <string.h>

#include "fixes.h"

#define SYNC_1 0xB5U
#define SYNC_2 0x62U
#define HEADER 6U
#define CHECKSUM 2U

#define POSITION 1U /* the parts of an epoch */
#define VELOCITY 2U
#define SOLUTION 4U
#define WHOLE 7U

static uint32_t little_u32(const uint8_t *bytes)
{
    return bytes[0] | ((uint32_t)bytes[1] << 8) | ((uint32_t)bytes[2] << 16) | ((uint32_t)bytes[3] << 24);
}

static int32_t little_i32(const uint8_t *bytes)
{
    return (int32_t)little_u32(bytes);
}

/* cm to mm. A nonsensical value must not wrap round to a sensible one. */
static uint32_t times_10(uint32_t value)
{
    return (value > (UINT32_MAX / 10U)) ? UINT32_MAX : (value * 10U);
}

static uint8_t ubx_length(const uint8_t *header)
{
    const uint8_t length = header[4]; /* of the payload, its high byte 0 */
    bool expected = false;

    if ((header[1] == SYNC_2) && (header[2] == UBX_NAV) && (header[5] == 0U)) {
        switch (header[3]) {
        case UBX_NAV_POSLLH:
            expected = posllh_has_length(length);
            break;
        case UBX_NAV_SOL:
            expected = sol_has_length(length);
            break;
        case UBX_NAV_PVT:
            expected = pvt_has_length(length);
            break;
        case UBX_NAV_VELNED:
            expected = velned_has_length(length);
            break;
        default:
            break;
        }
    }
    return expected ? (uint8_t)(HEADER + length + CHECKSUM) : 0U;
}

/* Fletcher's checksum over class to payload, eight bytes at a time: the lengths of all payloads and the 4 bytes
 * before them add up to multiples of 8. */
static bool ubx_intact(const uint8_t *frame, uint8_t length)
{
    const uint8_t *byte = &frame[2];
    const uint8_t *const end = &frame[length - CHECKSUM];
    uint8_t a = 0U;
    uint8_t b = 0U;

    while (byte < end) {
        a = (uint8_t)(a + byte[0]);
        b = (uint8_t)(b + a);
        a = (uint8_t)(a + byte[1]);
        b = (uint8_t)(b + a);
        a = (uint8_t)(a + byte[2]);
        b = (uint8_t)(b + a);
        a = (uint8_t)(a + byte[3]);
        b = (uint8_t)(b + a);
        a = (uint8_t)(a + byte[4]);
        b = (uint8_t)(b + a);
        a = (uint8_t)(a + byte[5]);
        b = (uint8_t)(b + a);
        a = (uint8_t)(a + byte[6]);
        b = (uint8_t)(b + a);
        a = (uint8_t)(a + byte[7]);
        b = (uint8_t)(b + a);
        byte = &byte[8];
    }
    return (end[0] == a) && (end[1] == b);
}

/* Take a fix that the receiver calls good, if its epoch has had none and its values are in range. */
static ubx_event take_fix(ubx *m, const ubx_fix *fix)
{
    const bool known = m->fixed && (m->fix.time_ms == fix->time_ms);
    ubx_event event = UBX_FRAME;

    if (!known) {
        if (fix_in_range(fix)) {
            m->fix = *fix;
            m->fixed = true;
            event = UBX_FIX;
        } else {
            scanner_count(&m->refused, 1U);
        }
    }
    return event;
}

/* One of the three messages has come: it begins a new epoch or adds to the current one. */
static ubx_event add_part(ubx *m, uint8_t part, const uint8_t *payload)
{
    const uint32_t time_ms = little_u32(payload);
    ubx_event event = UBX_FRAME;

    if (time_ms != m->epoch.time_ms) {
        m->parts = 0U;
    }
    m->epoch.time_ms = time_ms;
    m->parts |= part;
    if (part == POSITION) {
        m->epoch.longitude = little_i32(&payload[4]);
        m->epoch.latitude = little_i32(&payload[8]);
        m->epoch.h_acc = little_u32(&payload[20]);
    } else if (part == VELOCITY) {
        m->epoch.speed = times_10(little_u32(&payload[20]));
        m->epoch.course = little_i32(&payload[24]);
        m->epoch.s_acc = times_10(little_u32(&payload[28]));
    } else {
        m->good = sol_is_fix(payload);
    }
    if (m->parts == WHOLE) {
        m->parts = 0U;
        if (m->good) {
            event = take_fix(m, &m->epoch);
        }
    }
    return event;
}

static ubx_event read_pvt(ubx *m, const uint8_t *payload, uint8_t length)
{
    ubx_event event = UBX_FRAME;

    if (pvt_is_fix(payload, length)) {
        ubx_fix fix;

        fix.time_ms = little_u32(payload);
        fix.longitude = little_i32(&payload[24]);
        fix.latitude = little_i32(&payload[28]);
        fix.h_acc = little_u32(&payload[40]);
        fix.speed = little_u32(&payload[60]); /* signed in the message: below zero it is out of range */
        fix.course = little_i32(&payload[64]);
        fix.s_acc = little_u32(&payload[68]);
        event = take_fix(m, &fix);
    }
    return event;
}

void ubx_init(ubx *m)
{
    (void)memset(m, 0, sizeof(*m));
}

ubx_event ubx_receive(ubx *m, scanner_input *input)
{
    static const scanner_protocol protocol = {SYNC_1, HEADER, ubx_length, ubx_intact};
    ubx_event event = UBX_NOTHING;

    if (scanner_next(&m->scanner, input, &protocol)) {
        const uint8_t *const payload = &m->scanner.frame[HEADER];

        switch (m->scanner.frame[3]) {
        case UBX_NAV_POSLLH:
            event = add_part(m, POSITION, payload);
            break;
        case UBX_NAV_VELNED:
            event = add_part(m, VELOCITY, payload);
            break;
        case UBX_NAV_SOL:
            event = add_part(m, SOLUTION, payload);
            break;
        default: /* NAV-PVT, the only other one of ubx_length */
            event = read_pvt(m, payload, (uint8_t)(m->scanner.length - HEADER - CHECKSUM));
            break;
        }
    }
    return event;
}
