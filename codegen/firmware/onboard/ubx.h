/* ubx: position and velocity from a u-blox receiver's binary protocol
 * Source: u-blox 5/6/M8 receiver description including protocol specification, class NAV.
 *
 * A fix is one epoch of the receiver: NAV-POSLLH, NAV-VELNED and NAV-SOL of the same time of week, in any
 * order (receivers such as the RCB-4H), or one NAV-PVT (newer ones). Only a fix by the rules of fixes.h
 * counts. Each counts once, even when both kinds of messages are sent. */
#ifndef UBX_H
#define UBX_H

#include "scanner.h"

typedef struct {
    uint32_t time_ms;  /* ms, GPS time of week (iTOW), within a week */
    int32_t latitude;  /* 1e-7 deg, in [-90, 90] deg */
    int32_t longitude; /* 1e-7 deg, in [-180, 180] deg */
    uint32_t h_acc;    /* mm, accuracy of the position, above 0 */
    uint32_t speed;    /* mm/s over ground, at most 515 m/s */
    int32_t course;    /* 1e-5 deg, clockwise from north, in [-360, 360] deg */
    uint32_t s_acc;    /* mm/s, accuracy of the speed, above 0 */
} ubx_fix;

typedef enum {
    UBX_NOTHING, /* the input is used up */
    UBX_FRAME,   /* a frame, at scanner.frame, that completes no fix */
    UBX_FIX      /* a new fix, in `fix` */
} ubx_event;

typedef struct {
    scanner scanner;
    bool fixed;       /* there has been a fix */
    ubx_fix fix;      /* the last one */
    ubx_fix epoch;    /* the current epoch, as far as it has come */
    uint8_t parts;    /* bits: which of the three messages have come */
    bool good;        /* NAV-SOL calls it good */
    uint32_t refused; /* good fixes with a value out of range; stops at its greatest value */
} ubx;

void ubx_init(ubx *m);

/* Read up to the end of the next frame; call until it returns UBX_NOTHING. */
ubx_event ubx_receive(ubx *m, scanner_input *input);

#endif
