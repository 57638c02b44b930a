/* The radio's frames: no access beyond a frame or a mission; a mission is whole and on earth. */
#include "link.c"
#include "telemetry.c"

#include "proof.h"

#define HELD 12U /* bytes in which an ABORT is looked for */

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

void scanner_abandon(scanner *s)
{
    (void)s;
}

/* A frame in the bytes held: that it lies there is what must be proved of link.c. */
void scanner_take(scanner *s, uint8_t place, uint8_t length)
{
    assert((place + length) <= s->count);
    s->frame = &s->bytes[s->start + place];
    s->length = length;
}

void scanner_count(uint32_t *counter, uint16_t more)
{
    *counter = (*counter > (UINT32_MAX - more)) ? UINT32_MAX : (*counter + more);
}

static bool on(const link_position *p)
{
    return (p->latitude >= -900000000) && (p->latitude <= 900000000) && (p->longitude >= -1800000000) &&
           (p->longitude <= 1800000000);
}

void prove_length(void)
{
    uint8_t header[HEADER];
    const uint8_t length = link_length(header);

    assert((length == 0U) || ((length >= (HEADER + CHECKSUM)) && (length <= 145U)));
}

void prove_intact(void)
{
    uint8_t frame[145];
    const uint8_t length = nondet_u8();

    __CPROVER_assume((length >= (HEADER + CHECKSUM)) && (length <= 145U));
    (void)link_intact(frame, length);
}

/* What is found in the bytes held lies there, whole: the stub of scanner_take. */
void prove_abort(void)
{
    scanner s;

    __CPROVER_assume((s.start <= SCANNER_SIZE) && (s.count <= (SCANNER_SIZE - s.start)) && (s.count <= HELD));
    (void)take_abort(&s);
}

static bool same(const link_position *p, const link_position *q)
{
    return (p->latitude == q->latitude) && (p->longitude == q->longitude);
}

static uint16_t number(const uint8_t *bytes)
{
    return (uint16_t)((bytes[0] * 256U) + bytes[1]);
}

/* Is it the position that eight bytes tell? */
static bool told(const link_position *p, const uint8_t *bytes)
{
    return (((uint32_t)p->latitude >> 16) == number(bytes)) && (((uint32_t)p->latitude & 0xFFFFU) == number(&bytes[2])) &&
           (((uint32_t)p->longitude >> 16) == number(&bytes[4])) &&
           (((uint32_t)p->longitude & 0xFFFFU) == number(&bytes[6]));
}

/* A message changes what it is for, and nothing else; one that is refused changes nothing. */
void prove_message(void)
{
    radio_link m;
    uint8_t frame[145];
    const uint8_t *const payload = &frame[HEADER];
    link_message message;
    const uint8_t place = nondet_u8();

    m.scanner.frame = frame;
    m.locked = nondet_bool();
    const radio_link before = m;
    __CPROVER_assume(place < LINK_MAX_WAYPOINTS);
    __CPROVER_assume(frame[LENGTH] <= MAX_PAYLOAD); /* by link_length */
    __CPROVER_assume(m.mission.count <= LINK_MAX_WAYPOINTS);
    message = take_message(&m);
    assert(m.mission.count <= LINK_MAX_WAYPOINTS);
    assert((message == LINK_NOTHING) || ((uint8_t)message == frame[TYPE]));
    assert(m.locked == before.locked);
    if (message == LINK_MISSION) {
        assert(!m.locked && (frame[LENGTH] == (2U + (8U * (1U + m.mission.count)))));
        assert((m.mission.count >= 1U) && (m.mission.id == number(payload)));
        assert(on(&m.mission.home) && told(&m.mission.home, &payload[2]));
        assert((place >= m.mission.count) || (on(&m.mission.waypoints[place]) &&
                                              told(&m.mission.waypoints[place], &payload[10U + (8U * place)])));
    } else {
        assert((m.mission.count == before.mission.count) && (m.mission.id == before.mission.id));
        assert(same(&m.mission.home, &before.mission.home));
        assert(same(&m.mission.waypoints[place], &before.mission.waypoints[place]));
    }
    assert(m.asked == ((message == LINK_START) ? number(payload) : before.asked));
    assert(m.override == ((message == LINK_OVERRIDE) ? payload[0] : before.override));
    assert((m.override <= 5U) || (message != LINK_OVERRIDE));
    assert(m.sequence == ((message == LINK_NOTHING) ? before.sequence : frame[3]));
    assert((message != LINK_NOTHING) || (frame[TYPE] != 4U) || (frame[LENGTH] != 0U)); /* an ABORT is taken */
}

void prove_telemetry(void)
{
    telemetry t;
    uint8_t frame[LINK_TELEMETRY_SIZE];

    assert(link_write_telemetry(frame, nondet_u8(), &t) == LINK_TELEMETRY_SIZE);
    assert((frame[0] == 0xA5U) && (frame[4] == 48U));
}
