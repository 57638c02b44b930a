/* link: the radio between the operator's laptop and the vest
 * Source: Miller 2010, 1.3 and 2.4 (what is sent); the frame is our own, since an XBee in transparent mode
 * carries bytes without bounds, acknowledgement or checksum.
 *
 * A frame: A5 5A, type, sequence number, length of the payload, payload, CRC-16/CCITT-FALSE of type to
 * payload. Big-endian. The sender counts its frames in the sequence number; the vest tells the last one it
 * received in its telemetry, so that the laptop repeats what got lost.
 *
 * type              payload
 * 1  MISSION        u16: its id; home, then 1 to 16 waypoints: each latitude, longitude [1e-7 deg] i32
 *                   the id is any number of the laptop's choosing, to tell missions apart
 * 2  START          u16: the id of the MISSION that is meant
 * 3  OVERRIDE       u8: the command, 0 releases
 * 4  ABORT          -
 * 5  HEARTBEAT      -
 * 16 TELEMETRY      the fields of link_telemetry in their order, its bools as bits of one byte, the first the
 *                   lowest; from the vest, all others are to it */
#ifndef LINK_H
#define LINK_H

#include "scanner.h"

#define LINK_MAX_WAYPOINTS 16U
#define LINK_TELEMETRY_SIZE 52U /* bytes of the frame */

typedef struct {
    int32_t latitude;  /* 1e-7 deg, in [-90, 90] deg */
    int32_t longitude; /* 1e-7 deg, in [-180, 180] deg */
} link_position;

typedef struct {
    link_position home;
    link_position waypoints[LINK_MAX_WAYPOINTS];
    uint8_t count; /* of waypoints; 0: no mission has come */
    uint16_t id;   /* by which it is started */
} link_mission;

typedef enum {
    LINK_NOTHING = 0,   /* the input is used up */
    LINK_MISSION = 1,   /* the new one, whole, in `mission` */
    LINK_START = 2,     /* of the very mission held */
    LINK_OVERRIDE = 3,  /* the command in `override` */
    LINK_ABORT = 4,
    LINK_HEARTBEAT = 5,
    LINK_TELEMETRY = 16 /* never received */
} link_message;

typedef struct {
    scanner scanner;
    link_mission mission;
    uint8_t override; /* command of the operator; 0: none */
    uint8_t sequence; /* of the last message taken */
    uint32_t refused; /* messages with a wrong length or value, starts of another mission than the one held */
    uint32_t unknown; /* messages of other types; both stop at their greatest value */
} radio_link; /* `link` is a function of POSIX */

typedef struct {
    uint32_t time_ms;              /* ms since power-up */
    int32_t latitude;              /* 1e-7 deg, estimate */
    int32_t longitude;             /* 1e-7 deg, estimate */
    int16_t speed;                 /* cm/s */
    int16_t heading;               /* 1e-4 rad, clockwise from north */
    uint16_t position_sd;          /* cm */
    uint16_t speed_sd;             /* cm/s */
    uint16_t distance;             /* dm, to the target */
    int16_t deviation;             /* 1e-4 rad, of the orientation from the target, right positive */
    uint16_t directional_commands; /* LEFT and RIGHT issued in this trial */
    uint8_t command;               /* what the animal is told */
    uint8_t mode;                  /* what the controller is doing */
    uint8_t status;                /* how the trial stands */
    uint8_t waypoint;              /* number of waypoints reached */
    uint8_t anomaly;               /* what keeps the controller from deciding */
    bool valid;                    /* the estimate; this and the next six are the bits of one byte */
    bool imu_ok;                   /* samples come */
    bool link_ok;                  /* the laptop is heard */
    bool fixed;                    /* there has been a fix */
    bool loaded;                   /* a mission is held */
    bool started;                  /* it is under way, or has ended */
    bool waiting;                  /* a START waits for a fix, or for the end of a stop */
    uint16_t mission_id;           /* of the mission under way; else of the one held */
    uint8_t received;              /* sequence number of the last message taken from the laptop */
    uint16_t gps_frames;           /* modulo 2^16 */
    uint16_t gps_errors;           /* wrong checksums; this and the other errors stop at 65535 */
    uint16_t imu_frames;           /* modulo 2^16 */
    uint16_t imu_errors;           /* wrong checksums */
    uint16_t link_errors;          /* wrong checksums */
} link_telemetry;

void link_init(radio_link *m);

/* Read up to the end of the next message that is right; call until it returns LINK_NOTHING. What is refused
 * changes nothing but the counters. */
link_message link_receive(radio_link *m, scanner_input *input);

/* Call on every tick while nothing has come for longer than a frame may pause (between two radio packets:
 * 0.2 s), then link_receive: a frame that lost its end would otherwise hold back an ABORT until others have
 * filled it up. */
void link_idle(radio_link *m);

/* Write a frame of LINK_TELEMETRY_SIZE bytes; returns that size. */
uint8_t link_write_telemetry(uint8_t *frame, uint8_t sequence, const link_telemetry *telemetry);

#endif
