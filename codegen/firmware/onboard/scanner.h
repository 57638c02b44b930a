/* scanner: finds the frames in a stream of bytes of which some may be lost, changed or foreign
 * Shared by the receiver (ubx), the inertial unit (mt) and the radio (link). All bytes zero is its start.
 *
 * A frame is trusted only when its checksum is right. Until then its bytes are kept. If the checksum is
 * wrong, they are searched again from the second byte on: a false, cut or damaged frame never swallows the
 * good one behind it. Frames of no interest are searched as well instead of skipped, since a false header
 * can claim any length. A damaged length is more likely than another frame's payload with a whole valid
 * frame in it. */
#ifndef SCANNER_H
#define SCANNER_H

#include <stdbool.h>
#include <stdint.h>

#define SCANNER_SIZE 213U /* bytes: the longest frame is the radio's mission */

/* Bytes that have come and are not read yet; reading moves `bytes` on. */
typedef struct {
    const uint8_t *bytes;
    uint16_t count;
} scanner_input;

/* The frames of a protocol. */
typedef struct {
    uint8_t sync;   /* the first byte of every frame */
    uint8_t header; /* bytes that tell the length of a frame */
    uint8_t (*length)(const uint8_t *header);             /* bytes of the whole frame; 0: no interest */
    bool (*intact)(const uint8_t *frame, uint8_t length); /* its checksum is right */
} scanner_protocol;

typedef struct {
    uint8_t bytes[SCANNER_SIZE]; /* the beginning of a frame whose rest is missing */
    uint8_t start;               /* place of its first byte */
    uint8_t count;               /* bytes held */
    uint8_t needed;              /* bytes that the next decision takes */
    uint8_t length;              /* of the frame found last */
    const uint8_t *frame;        /* its place, in the input or in `bytes`, until the next call */
    uint32_t frames;             /* found; this and the next two stop at their greatest value */
    uint32_t errors;             /* frames with a wrong checksum */
    uint32_t skipped;            /* bytes outside all frames */
} scanner;

/* Read up to the end of the next frame, which is then at `frame`. Returns false when the input is used up:
 * call until then, since one block can hold many frames. */
bool scanner_next(scanner *s, scanner_input *input, const scanner_protocol *protocol);

/* Give up a frame whose rest has been missing for too long. The next call searches the bytes behind its
 * first. */
void scanner_abandon(scanner *s);

/* Take a frame that lies whole in the bytes held, at a place from the first of them; it is then at `frame`. The
 * bytes before it are skipped. */
void scanner_take(scanner *s, uint8_t place, uint8_t length);

/* Count, stopping at the greatest value. */
void scanner_count(uint32_t *counter, uint16_t more);

#endif
