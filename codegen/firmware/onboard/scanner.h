/* scanner: finds the frames in a stream of bytes of which some may be lost, changed or foreign
 * Shared by the receiver (ubx), the inertial unit (mt) and the radio (link). All bytes zero is its start.
 *
 * A frame that has begun is trusted only when its checksum is right. Until then its bytes are kept, and when
 * it proves none, they are searched again from the second one on: a false, cut or damaged frame never takes
 * the good one behind it along. Frames that are not wanted are therefore not skipped but searched as well:
 * the length that a false one claims could be anything. That a wanted frame with the right length and
 * checksum stands in the middle of another's payload is less likely than a damaged length. */
#ifndef SCANNER_H
#define SCANNER_H

#include <stdbool.h>
#include <stdint.h>

#define SCANNER_SIZE 145U /* bytes: the longest frame is the radio's mission */

/* Bytes that have come and are not yet read; reading moves it on. */
typedef struct {
    const uint8_t *bytes;
    uint16_t count;
} scanner_input;

/* What a protocol's frames look like. */
typedef struct {
    uint8_t sync;   /* the first byte of every frame */
    uint8_t header; /* bytes from which the length of a frame can be told */
    uint8_t (*length)(const uint8_t *header);             /* bytes of the whole frame; 0: not wanted */
    bool (*intact)(const uint8_t *frame, uint8_t length); /* its checksum is right */
} scanner_protocol;

typedef struct {
    uint8_t bytes[SCANNER_SIZE]; /* what has come of a frame whose rest is missing */
    uint8_t start;               /* place of its first byte */
    uint8_t count;               /* bytes held */
    uint8_t needed;              /* bytes that must be there to decide further */
    uint8_t length;              /* of the frame found last */
    const uint8_t *frame;        /* its place, in the input or in `bytes`, until the next call */
    uint32_t frames;             /* found; this and the next two stop at their greatest value */
    uint32_t errors;             /* frames with a wrong checksum */
    uint32_t skipped;            /* bytes that are part of no frame */
} scanner;

/* Read up to the end of the next frame. Returns whether there is one, at `frame`; false when the input is used
 * up: call until then, since one block can hold, or complete, many. */
bool scanner_next(scanner *s, scanner_input *input, const scanner_protocol *protocol);

/* Give up the frame that has begun, because its rest has been missing for too long; the next call searches
 * what came behind its first byte. */
void scanner_abandon(scanner *s);

/* Count, stopping at the greatest value. */
void scanner_count(uint32_t *counter, uint16_t more);

#endif
