/* link: the radio between the operator's laptop and the vest
 * Source: Miller 2010, 1.3 and 2.4 (messages); the frame is our own, since an XBee in transparent mode
 * carries bytes without bounds, acknowledgement or checksum.
 *
 * A frame: A5 5A, type, sequence number, length of the payload, payload, CRC-16/CCITT-FALSE of type to
 * payload. Big-endian. The sender counts its frames in the sequence number. The telemetry returns the number
 * of the last message taken, so that the laptop can repeat a lost one.
 *
 * type              payload
 * 1  MISSION        u16: its id; home, then 1 to 16 waypoints: each latitude, longitude [1e-7 deg] i32
 *                   the laptop chooses the id, by which missions are told apart
 * 2  START          u16: the id of the MISSION to begin, at once or not at all
 * 3  OVERRIDE       u8: the command, 0 releases; it holds for a time only unless it is sent again
 * 4  ABORT          -
 * 5  HEARTBEAT      -
 * 16 TELEMETRY      the fields of `telemetry` in their order, its bools as the bits of one byte, the first as
 *                   the lowest. It comes from the vest; all others go to it */
#ifndef LINK_H
#define LINK_H

#include "models.h"
#include "scanner.h"
#include "telemetry.h"

#define LINK_TELEMETRY_SIZE (TELEMETRY_SIZE + 7U) /* bytes of the frame */

typedef struct {
    int32_t latitude;  /* 1e-7 deg, in [-90, 90] deg */
    int32_t longitude; /* 1e-7 deg, in [-180, 180] deg */
} link_position;

typedef struct {
    link_position home;
    link_position waypoints[LINK_MAX_WAYPOINTS];
    uint8_t count; /* of waypoints; 0: no mission is held */
    uint16_t id;   /* by which it is started */
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
    uint8_t sequence; /* of the last message taken */
    uint32_t refused; /* messages with a wrong length or value, a MISSION while it is locked */
    uint32_t unknown; /* messages of other types; both counters stop at their greatest value */
} radio_link; /* `link` is a function of POSIX */

void link_init(radio_link *m);

/* Read up to the end of the next valid message; call until it returns LINK_NOTHING. A refused message changes
 * only the counters.
 * An ABORT is taken on the tick of its last byte, whatever came before (rule 10): once the input is used up, it
 * is looked for in the bytes of a frame whose rest is missing, since that frame may be a false one. What was
 * held before it is lost, a MISSION say, which the laptop sends again. By accident the bytes of a MISSION that
 * comes in pieces look so once in 2^48 places; such a false stop is safe. */
link_message link_receive(radio_link *m, scanner_input *input);

/* Abandon a frame that lost its end: until later bytes had filled it up, it would hold back others. Call on
 * every tick once the radio has been silent for longer than a frame may pause (between two radio packets:
 * 0.2 s), and link_receive behind it. */
void link_idle(radio_link *m);

/* Write a frame of LINK_TELEMETRY_SIZE bytes; returns that size. */
uint8_t link_write_telemetry(uint8_t *frame, uint8_t sequence, const telemetry *t);

#endif
