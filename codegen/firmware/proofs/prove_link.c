/* The radio's frames: no access beyond a frame or a mission; a mission is whole and on earth; rule 11. */
#include "link.c"
#include "telemetry.c"

#include "proof.h"

#define HELD 19U  /* bytes in which an ABORT is looked for */
#define ROOM 213U /* bytes of the longest frame */

static uint8_t frame[ROOM];

/* Finds any frame of the protocol's length, or none: prove_scanner.c proves this of the scanner. */
bool scanner_next(scanner *s, scanner_input *input, const scanner_protocol *protocol)
{
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

/* Any tag: what SipHash-2-4 gives is tested against its authors' vectors. The bytes that it takes are read. */
const uint8_t vest_key[16] = {0};
static uint8_t read_last;
static uint8_t tag_made[8];
static bool made; /* over the session and the whole frame to its payload */
static uint8_t taken;
static bool whole;

/* Is it the tag that was made? */
static bool same_tag(const uint8_t *tag)
{
    uint8_t same = 0U;

    for (uint8_t i = 0U; i < 8U; i++) {
        same = (uint8_t)(same + ((tag[i] == tag_made[i]) ? 1U : 0U));
    }
    return same == 8U;
}

void siphash_begin(siphash *h, const uint8_t *key)
{
    (void)h;
    assert(key == vest_key);
    taken = 0U;
}

void siphash_take(siphash *h, const uint8_t *bytes, uint8_t count)
{
    (void)h;
    assert(count > 0U);
    read_last = bytes[count - 1U];
    if (taken == 0U) {
        whole = count == (uint8_t)(6U + bytes[1]);
    }
    taken = (uint8_t)(taken + count);
    made = whole && (count == 4U);
}

void siphash_end(siphash *h, uint8_t *tag)
{
    (void)h;
    for (uint8_t i = 0U; i < SIPHASH_TAG; i++) {
        tag_made[i] = nondet_u8();
        tag[i] = tag_made[i];
    }
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

    assert((length == 0U) || ((length >= 18U) && (length <= ROOM)));
    assert((length == 0U) || (length == (18U + header[3])));
}

void prove_intact(void)
{
    const uint8_t length = nondet_u8();

    __CPROVER_assume((length >= 18U) && (length <= ROOM));
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

static uint32_t counted(const uint8_t *bytes)
{
    return ((uint32_t)number(bytes) << 16) | number(&bytes[2]);
}

/* A frame is accepted only if its tag is the one that the key makes, its counter has grown, and it answers a
 * telemetry that was told and, but for an ABORT, one of the last. One that is not changes only a count. */
void prove_accept(void)
{
    radio_link m;
    const uint32_t forged = nondet_u32();
    const uint32_t replayed = nondet_u32();

    __CPROVER_havoc_object(frame);
    __CPROVER_assume(frame[LENGTH] <= MAX_PAYLOAD); /* by link_length */
    m.forged = forged;
    m.replayed = replayed;
    const radio_link before = m;
    const uint32_t counter = counted(&frame[4]);
    const uint32_t answered = counter / 256U;
    const bool fresh = (answered <= m.told) && ((frame[2] == 4U) || ((m.told - answered) <= 15U));
    const bool accepted = accept(&m, frame);
    assert(!accepted || (made && same_tag(&frame[8U + frame[3]])));
    assert(!accepted || ((counter > before.received) && fresh));
    assert(accepted || !same_tag(&frame[8U + frame[3]]) || (counter <= before.received) || !fresh);
    assert(m.received == (accepted ? counter : before.received));
    assert((m.forged - forged) + (m.replayed - replayed) <= 1U);
    assert((m.forged == forged) || !same_tag(&frame[8U + frame[3]]));
    assert((m.told == before.told) && (m.session == before.session) && (m.nonce == before.nonce));
    assert((m.override == before.override) && (m.asked == before.asked) && (m.mission.id == before.mission.id));
}

/* A message changes what it is for, and nothing else; one that is refused changes nothing. */
void prove_message(void)
{
    radio_link m;
    const uint8_t *const payload = &frame[HEADER];
    link_message message;
    const uint8_t place = nondet_u8();
    const uint8_t corner = nondet_u8();

    __CPROVER_havoc_object(frame);
    m.locked = nondet_bool();
    const radio_link before = m;
    __CPROVER_assume(place < LINK_MAX_WAYPOINTS);
    __CPROVER_assume(frame[LENGTH] <= MAX_PAYLOAD); /* by link_length */
    __CPROVER_assume((m.mission.count <= LINK_MAX_WAYPOINTS) && (m.mission.corners <= LINK_MAX_CORNERS));
    __CPROVER_assume(corner < LINK_MAX_CORNERS);
    message = take_message(&m, frame);
    assert((m.mission.count <= LINK_MAX_WAYPOINTS) && (m.mission.corners <= LINK_MAX_CORNERS));
    assert((message == LINK_NOTHING) || ((uint8_t)message == frame[TYPE]));
    assert(m.locked == before.locked);
    if (message == LINK_MISSION) {
        const uint8_t *const home = &payload[3U + (8U * m.mission.corners)];

        assert(!m.locked && (frame[LENGTH] == (3U + (8U * (m.mission.corners + 1U + m.mission.count)))));
        assert((m.mission.count >= 1U) && (m.mission.id == number(payload)) && (m.mission.corners == payload[2]));
        assert((m.mission.corners == 0U) || (m.mission.corners >= 3U));
        assert(on(&m.mission.home) && told(&m.mission.home, home));
        assert((place >= m.mission.count) ||
               (on(&m.mission.waypoints[place]) && told(&m.mission.waypoints[place], &home[8U + (8U * place)])));
        assert((corner >= m.mission.corners) ||
               (on(&m.mission.fence[corner]) && told(&m.mission.fence[corner], &payload[3U + (8U * corner)])));
    } else {
        assert((m.mission.count == before.mission.count) && (m.mission.id == before.mission.id));
        assert((m.mission.corners == before.mission.corners) &&
               same(&m.mission.fence[corner], &before.mission.fence[corner]));
        assert(same(&m.mission.home, &before.mission.home));
        assert(same(&m.mission.waypoints[place], &before.mission.waypoints[place]));
    }
    assert(m.asked == ((message == LINK_START) ? number(payload) : before.asked));
    assert(m.override == ((message == LINK_OVERRIDE) ? payload[0] : before.override));
    assert((m.override <= 5U) || (message != LINK_OVERRIDE));
    assert(m.nonce == ((message == LINK_HEARTBEAT) ? counted(payload) : before.nonce));
    assert((m.received == before.received) && (m.session == before.session) && (m.told == before.told));
    assert((message != LINK_NOTHING) || (frame[TYPE] != 4U) || (frame[LENGTH] != 0U)); /* an ABORT is taken */
}

void prove_telemetry(void)
{
    radio_link m;
    telemetry t;
    uint8_t sent[LINK_TELEMETRY_SIZE];
    const uint32_t told = m.told;

    assert(link_write_telemetry(&m, sent, &t) == LINK_TELEMETRY_SIZE);
    assert((sent[0] == 0xA5U) && (sent[3] == TELEMETRY_SIZE));
    assert((m.told == (told + 1U)) && (counted(&sent[4]) == m.told));
    assert(made && same_tag(&sent[8U + TELEMETRY_SIZE]));
}
