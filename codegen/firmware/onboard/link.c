/* link: the radio between the operator's laptop and the vest
 * Source: Miller 2010, 1.3 and 2.4 (messages); the frame is described in link.h. */
#include "link.h"

#include "key.h"
#include "siphash.h"

#include <limits.h>
#include <string.h>

#define SYNC_1 0xA5U
#define SYNC_2 0x5AU
#define TYPE 2U /* places in a frame */
#define LENGTH 3U
#define COUNTER 4U
#define HEADER 8U
#define CHECKSUM 2U
#define ABORT_SIZE (HEADER + SIPHASH_TAG + CHECKSUM)

#define POSITION 8U /* bytes of a latitude and a longitude */
#define ID 2U       /* of a mission's id */
#define NONCE 4U    /* and of a HEARTBEAT's nonce */
#define PLACES (ID + 1U) /* where a mission's positions begin, behind the number of its corners */
#define MIN_CORNERS 3U
#define MAX_PAYLOAD (PLACES + (POSITION * (LINK_MAX_CORNERS + 1U + LINK_MAX_WAYPOINTS)))
#define TELEMETRY_END (HEADER + TELEMETRY_SIZE)
#define ANSWERED 8U /* bits of a counter below the number of a telemetry */

#if (HEADER + MAX_PAYLOAD + SIPHASH_TAG + CHECKSUM) > SCANNER_SIZE
#error "a mission is longer than the scanner's buffer"
#endif

#define MAX_LATITUDE 900000000
#define MAX_LONGITUDE 1800000000
#define MAX_COMMAND 5U

/* CRC-16/CCITT-FALSE: polynomial 0x1021, from 0xFFFF, without a table. */
static uint16_t crc16(const uint8_t *bytes, uint8_t count)
#if UINT_MAX > 0xFFFFU
{ /* two bytes at a time: q is the quotient of their polynomial, times x^16, by the CRC's */
    const uint8_t even = (uint8_t)(count & 0xFEU);
    uint32_t crc = 0xFFFFU;

    for (uint8_t i = 0U; i < even; i = (uint8_t)(i + 2U)) {
        const uint32_t x = (crc & 0xFFFFU) ^ (((uint32_t)bytes[i] << 8) | bytes[i + 1U]);
        const uint32_t a = x ^ (x >> 4);
        const uint32_t q = a ^ (a >> 8) ^ (x >> 11);

        crc = q ^ (q << 5) ^ (q << 12);
    }
    if (even < count) {
        uint32_t x = ((crc >> 8) & 0xFFU) ^ bytes[even];

        x ^= x >> 4;
        crc = (crc << 8) ^ x ^ (x << 5) ^ (x << 12);
    }
    return (uint16_t)(crc & 0xFFFFU);
}
#else
{ /* a byte at a time, in two bytes: a small processor shifts 16 bits in a loop */
    uint8_t high = 0xFFU;
    uint8_t low = 0xFFU;

    for (uint8_t i = 0U; i < count; i++) {
        uint8_t x = high ^ bytes[i];

        x ^= (uint8_t)(x >> 4);
        high = (uint8_t)(low ^ (uint8_t)(x << 4) ^ (x >> 3));
        low = (uint8_t)(x ^ (uint8_t)(x << 5));
    }
    return (uint16_t)(((uint16_t)high << 8) | low);
}
#endif

static uint16_t big_u16(const uint8_t *bytes)
{
    return (uint16_t)(((uint16_t)bytes[0] << 8) | bytes[1]);
}

static uint32_t big_u32(const uint8_t *bytes)
{
    return ((uint32_t)big_u16(bytes) << 16) | big_u16(&bytes[2]);
}

static void put_u32(uint8_t *bytes, uint32_t value)
{
    bytes[0] = (uint8_t)(value >> 24);
    bytes[1] = (uint8_t)((value >> 16) & 0xFFU);
    bytes[2] = (uint8_t)((value >> 8) & 0xFFU);
    bytes[3] = (uint8_t)(value & 0xFFU);
}

#if KEY_SIGNS

/* The tag of a frame whose payload has so many bytes: over type to payload, and the session. */
static void make_tag(uint32_t session, const uint8_t *frame, uint8_t length, uint8_t *tag)
{
    siphash h;
    uint8_t number[4];

    put_u32(number, session);
    siphash_begin(&h, vest_key);
    siphash_take(&h, &frame[TYPE], (uint8_t)(HEADER - TYPE + length));
    siphash_take(&h, number, (uint8_t)sizeof(number));
    siphash_end(&h, tag);
}

/* Is a frame's tag right? The time that it takes does not tell how much of it is. */
static bool link_genuine(uint32_t session, const uint8_t *frame)
{
    const uint8_t length = frame[LENGTH];
    const uint8_t *const got = &frame[HEADER + length];
    uint8_t expected[SIPHASH_TAG];
    uint8_t different = 0U;

    make_tag(session, frame, length, expected);
    for (uint8_t i = 0U; i < SIPHASH_TAG; i++) {
        different |= (uint8_t)(got[i] ^ expected[i]);
    }
    return different == 0U;
}

#else /* INSECURE: a program without a key */

static void make_tag(uint32_t session, const uint8_t *frame, uint8_t length, uint8_t *tag)
{
    (void)session;
    (void)frame;
    (void)length;
    (void)memset(tag, 0, SIPHASH_TAG);
}

static bool link_genuine(uint32_t session, const uint8_t *frame)
{
    (void)session;
    (void)frame;
    return true;
}

#endif

static uint8_t link_length(const uint8_t *header)
{
    const bool possible = (header[1] == SYNC_2) && (header[LENGTH] <= MAX_PAYLOAD);

    return possible ? (uint8_t)(HEADER + header[LENGTH] + SIPHASH_TAG + CHECKSUM) : 0U;
}

static bool link_intact(const uint8_t *frame, uint8_t length)
{
    const uint8_t end = (uint8_t)(length - CHECKSUM);

    return crc16(&frame[TYPE], (uint8_t)(end - TYPE)) == big_u16(&frame[end]);
}

static bool link_aborts(const uint8_t *frame)
{
    return (frame[0] == SYNC_1) && (frame[1] == SYNC_2) && (frame[TYPE] == (uint8_t)LINK_ABORT) &&
           (frame[LENGTH] == 0U) && link_intact(frame, (uint8_t)ABORT_SIZE);
}

/* Take an ABORT out of the bytes held, which otherwise wait until the frame that they seem to begin is whole.
 * Returns whether there was one. */
static bool take_abort(scanner *s)
{
    const uint8_t *const held = &s->bytes[s->start];
    bool aborted = false;

    for (uint8_t i = 0U; !aborted && ((i + ABORT_SIZE) <= s->count); i++) {
        aborted = link_aborts(&held[i]);
        if (aborted) {
            scanner_take(s, i, (uint8_t)ABORT_SIZE);
        }
    }
    return aborted;
}

static link_position get_position(const uint8_t *bytes)
{
    link_position position;

    position.latitude = (int32_t)big_u32(bytes);
    position.longitude = (int32_t)big_u32(&bytes[4]);
    return position;
}

static bool on_earth(const link_position *position)
{
    return (position->latitude >= -MAX_LATITUDE) && (position->latitude <= MAX_LATITUDE) &&
           (position->longitude >= -MAX_LONGITUDE) && (position->longitude <= MAX_LONGITUDE);
}

/* Read so many positions; returns what comes behind them. */
static const uint8_t *get_positions(link_position *to, uint8_t count, const uint8_t *bytes)
{
    for (uint8_t i = 0U; i < count; i++) {
        to[i] = get_position(&bytes[POSITION * i]);
    }
    return &bytes[POSITION * count];
}

/* A mission is taken whole or not at all: all of it is checked before anything is changed. */
static bool take_mission(radio_link *m, const uint8_t *payload, uint8_t length)
{
    const uint8_t corners = payload[ID]; /* of a payload without: a byte of the tag, and no place is there */
    const uint8_t end = (length >= PLACES) ? (uint8_t)(length - PLACES) : 0U;
    const uint8_t places = (uint8_t)(end / POSITION);
    bool valid = !m->locked && ((end % POSITION) == 0U) && (places >= (corners + 2U)) &&
                 (places <= (corners + 1U + LINK_MAX_WAYPOINTS)) &&
                 ((corners == 0U) || ((corners >= MIN_CORNERS) && (corners <= LINK_MAX_CORNERS)));

    for (uint8_t i = 0U; valid && (i < end); i = (uint8_t)(i + POSITION)) {
        const link_position position = get_position(&payload[PLACES + i]);

        valid = on_earth(&position);
    }
    if (valid) {
        const uint8_t *next = &payload[PLACES];

        m->mission.id = big_u16(payload);
        m->mission.corners = corners;
        m->mission.count = (uint8_t)((places - corners) - 1U);
        next = get_positions(m->mission.fence, corners, next);
        next = get_positions(&m->mission.home, 1U, next);
        (void)get_positions(m->mission.waypoints, m->mission.count, next);
    }
    return valid;
}

static bool take_override(radio_link *m, const uint8_t *payload, uint8_t length)
{
    const bool valid = (length == 1U) && (payload[0] <= MAX_COMMAND);

    if (valid) {
        m->override = payload[0];
    }
    return valid;
}

static bool take_heartbeat(radio_link *m, const uint8_t *payload, uint8_t length)
{
    const bool valid = length == NONCE;

    if (valid) {
        m->nonce = big_u32(payload);
    }
    return valid;
}

/* Does a frame come from the owner of the key, in this session, now, and for the first time (rule 11)? One
 * that does is the last received. */
static bool accept(radio_link *m, const uint8_t *frame)
{
    const uint32_t counter = big_u32(&frame[COUNTER]);
    const uint32_t age = m->told - (counter >> ANSWERED); /* beyond `told` for a telemetry that is yet to come */
    const uint32_t oldest = (frame[TYPE] == (uint8_t)LINK_ABORT) ? m->told : LINK_FRESH;
    bool accepted = false;

    if (!link_genuine(m->session, frame)) {
        scanner_count(&m->forged, 1U);
    } else if ((counter <= m->received) || (age > oldest)) {
        scanner_count(&m->replayed, 1U);
    } else {
        m->received = counter;
        accepted = true;
    }
    return accepted;
}

/* Take the message in an accepted frame. Returns its type, or LINK_NOTHING if it is refused. */
static link_message take_message(radio_link *m, const uint8_t *frame)
{
    const uint8_t *const payload = &frame[HEADER];
    const uint8_t length = frame[LENGTH];
    link_message message = LINK_NOTHING;
    bool known = true;

    switch (frame[TYPE]) {
    case LINK_MISSION:
        message = take_mission(m, payload, length) ? LINK_MISSION : LINK_NOTHING;
        break;
    case LINK_START:
        if (length == ID) {
            m->asked = big_u16(payload);
            message = LINK_START;
        }
        break;
    case LINK_OVERRIDE:
        message = take_override(m, payload, length) ? LINK_OVERRIDE : LINK_NOTHING;
        break;
    case LINK_ABORT:
        message = (length == 0U) ? LINK_ABORT : LINK_NOTHING;
        break;
    case LINK_HEARTBEAT:
        message = take_heartbeat(m, payload, length) ? LINK_HEARTBEAT : LINK_NOTHING;
        break;
    default:
        known = false;
        break;
    }
    if (message == LINK_NOTHING) {
        scanner_count(known ? &m->refused : &m->unknown, 1U);
    }
    return message;
}

void link_init(radio_link *m, uint32_t session)
{
    (void)memset(m, 0, sizeof(*m));
    m->session = session;
}

link_message link_receive(radio_link *m, scanner_input *input)
{
    static const scanner_protocol protocol = {SYNC_1, COUNTER, link_length, link_intact};
    link_message message = LINK_NOTHING;

    while ((message == LINK_NOTHING) &&
           (scanner_next(&m->scanner, input, &protocol) || take_abort(&m->scanner))) {
        if (accept(m, m->scanner.frame)) {
            message = take_message(m, m->scanner.frame);
        }
    }
    return message;
}

void link_idle(radio_link *m)
{
    scanner_abandon(&m->scanner);
}

uint8_t link_write_telemetry(radio_link *m, uint8_t *frame, const telemetry *t)
{
    uint16_t checksum;

    m->told++;
    frame[0] = SYNC_1;
    frame[1] = SYNC_2;
    frame[TYPE] = (uint8_t)LINK_TELEMETRY;
    frame[LENGTH] = (uint8_t)TELEMETRY_SIZE;
    put_u32(&frame[COUNTER], m->told);
    telemetry_write(&frame[HEADER], t);
    make_tag(m->session, frame, (uint8_t)TELEMETRY_SIZE, &frame[TELEMETRY_END]);
    checksum = crc16(&frame[TYPE], (uint8_t)(TELEMETRY_END + SIPHASH_TAG - TYPE));
    frame[TELEMETRY_END + SIPHASH_TAG] = (uint8_t)(checksum >> 8);
    frame[TELEMETRY_END + SIPHASH_TAG + 1U] = (uint8_t)(checksum & 0xFFU);
    return (uint8_t)LINK_TELEMETRY_SIZE;
}
