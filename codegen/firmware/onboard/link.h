/* link: the radio between the operator's laptop and the vest
 * Source: Miller 2010, 1.3 and 2.4 (messages); the frame is our own, since an XBee in transparent mode
 * carries bytes without bounds, acknowledgement or checksum.
 *
 * A frame: A5 5A, type, length of the payload, counter u32, payload, tag of 8 bytes, CRC-16/CCITT-FALSE of type
 * to tag. Big-endian.
 *
 * type              payload
 * 1  MISSION        u16: its id; u8: the number of corners of its fence, 0 or 3 to 7; these corners, home, 1 to 16
 *                   waypoints: each latitude, longitude [1e-7 deg] i32. The laptop chooses the id, by which
 *                   missions are told apart, and sees that the fence does not cross itself
 * 2  START          u16: the id of the MISSION to begin, at once or not at all
 * 3  OVERRIDE       u8: the command, 0 releases; it holds for a time only unless it is sent again
 * 4  ABORT          -
 * 5  HEARTBEAT      u32: the laptop's nonce
 * 16 TELEMETRY      the fields of `telemetry` in their order, its bools as the bits of one byte, the first as
 *                   the lowest. It comes from the vest; all others go to it
 *
 * Only the handler (rule 11). The tag is SipHash-2-4 by the vest's key over the frame from type to payload, and
 * the session, u32. The session is a number that the vest has from its port, another after each reset; its
 * telemetry tells it. A wrong CRC is damage. A right CRC with a wrong tag is a forged frame.
 *
 * The counter only grows, in each direction. The telemetry is counted from 1. The counter of the laptop's frames
 * is at least 256 times that of the last telemetry that it heard: so it has grown when the laptop was started
 * anew, and tells the vest how old the frame is at most. A frame whose counter is not above the last accepted,
 * or that answers a telemetry before the last LINK_FRESH, is replayed, and is not obeyed. An ABORT may be old.
 *
 * The telemetry returns the laptop's nonce, which the laptop draws for each session that it hears of. Until then
 * it does not believe the telemetry: that may be a recording. */
#ifndef LINK_H
#define LINK_H

#include "models.h"
#include "scanner.h"
#include "telemetry.h"

#define LINK_TELEMETRY_SIZE (TELEMETRY_SIZE + 18U) /* bytes of the frame */
#define LINK_FRESH 15U /* telemetries: 3 s at the shipped period */

typedef struct {
    int32_t latitude;  /* 1e-7 deg, in [-90, 90] deg */
    int32_t longitude; /* 1e-7 deg, in [-180, 180] deg */
} link_position;

typedef struct {
    link_position home;
    link_position waypoints[LINK_MAX_WAYPOINTS];
    link_position fence[LINK_MAX_CORNERS];
    uint8_t count;   /* of waypoints; 0: no mission is held */
    uint8_t corners; /* of its fence; 0: it has none */
    uint16_t id;     /* by which it is started */
} link_mission;

typedef enum {
    LINK_NOTHING = 0,   /* the input is used up */
    LINK_MISSION = 1,   /* the new one, whole, in `mission` */
    LINK_START = 2,     /* of the mission `asked` */
    LINK_OVERRIDE = 3,  /* the command in `override` */
    LINK_ABORT = 4,
    LINK_HEARTBEAT = 5,
    LINK_TELEMETRY = 16 /* never received */
} link_message;

typedef struct {
    scanner scanner;
    link_mission mission;
    bool locked;      /* no mission is taken: that held is under way (rule 9) */
    uint16_t asked;   /* id of the mission of the last START */
    uint8_t override; /* command of the operator; 0: none */
    uint32_t session;  /* of the vest */
    uint32_t told;     /* counter of the last telemetry */
    uint32_t received; /* counter of the last frame accepted */
    uint32_t nonce;    /* of the last HEARTBEAT; 0: none */
    uint32_t forged;   /* frames with a wrong tag; this and the next three stop at their greatest value */
    uint32_t replayed; /* frames that came before, or too late */
    uint32_t refused;  /* messages with a wrong length or value, a MISSION while it is locked */
    uint32_t unknown;  /* messages of other types */
} radio_link; /* `link` is a function of POSIX */

/* A session begins: its number must differ from those before, and nobody may choose it (port.h). */
void link_init(radio_link *m, uint32_t session);

/* Read up to the end of the next valid message; call until it returns LINK_NOTHING. A frame that is forged or
 * replayed, or a message that is refused, changes only the counters.
 * An ABORT is taken on the tick of its last byte, whatever came before (rule 10): once the input is used up, it
 * is looked for in the bytes of a frame whose rest is missing, since that frame may be a false one. What was
 * held before it is lost, a MISSION say, which the laptop sends again. By accident the bytes of a MISSION that
 * comes in pieces look so once in 2^48 places; it is then lost, and nothing obeys what is no ABORT. */
link_message link_receive(radio_link *m, scanner_input *input);

/* Abandon a frame that lost its end: until later bytes had filled it up, it would hold back others. Call on
 * every tick once the radio has been silent for longer than a frame may pause (between two radio packets:
 * 0.2 s), and link_receive behind it. */
void link_idle(radio_link *m);

/* Write the next telemetry as a frame of LINK_TELEMETRY_SIZE bytes; returns that size. */
uint8_t link_write_telemetry(radio_link *m, uint8_t *frame, const telemetry *t);

#endif
