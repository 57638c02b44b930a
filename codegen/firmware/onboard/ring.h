/* ring: bytes on their way between an interrupt handler and the program
 * For ports whose serial lines interrupt. One side puts and the other takes; each moves only its own index.
 * An index is one byte, which every processor reads and writes in one access: interrupts may stay on. All
 * zero is empty. */
#ifndef RING_H
#define RING_H

#include <stdbool.h>
#include <stdint.h>

#define RING_SIZE 256U /* bytes, one of them free; indices wrap by themselves. A tick at 57600 baud is 230 */

typedef struct {
    uint8_t bytes[RING_SIZE];
    volatile uint8_t put;   /* where the next byte goes */
    volatile uint8_t taken; /* where the next byte comes from */
    uint8_t lent;           /* bytes from there on that the program still reads */
} ring;

/* Bytes that can be put. */
static inline uint8_t ring_room(const ring *r)
{
    const uint8_t taken = r->taken;

    return (uint8_t)(taken - r->put - 1U);
}

/* Put a byte. Without room it is lost, which the protocols' checksums reveal. */
static inline void ring_put(ring *r, uint8_t byte)
{
    const uint8_t at = r->put;
    const uint8_t next = (uint8_t)(at + 1U);

    if (next != r->taken) {
        r->bytes[at] = byte;
        r->put = next;
    }
}

/* Take the oldest byte. Returns false if there is none. */
static inline bool ring_take(ring *r, uint8_t *byte)
{
    const uint8_t at = r->taken;
    const bool taken = at != r->put;

    if (taken) {
        *byte = r->bytes[at];
        r->taken = (uint8_t)(at + 1U);
    }
    return taken;
}

/* The oldest bytes in place, up to the end of the ring; returns how many. They stay there until the next
 * call, which takes them. */
static inline uint16_t ring_lend(ring *r, const uint8_t **bytes)
{
    const uint8_t at = (uint8_t)(r->taken + r->lent);
    const uint8_t put = r->put;

    r->taken = at;
    r->lent = (uint8_t)(((put >= at) ? put : RING_SIZE) - at);
    *bytes = &r->bytes[at];
    return r->lent;
}

#endif
