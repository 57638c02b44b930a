/* scanner: finds the frames in a stream of bytes of which some may be lost, changed or foreign
 * Time: a byte of a good frame is copied in bulk and summed once. At worst every byte begins what looks like
 * a frame, whose header is read, and every header's length of bytes one that is summed in vain. */
#include "scanner.h"

#include <string.h>

void scanner_count(uint32_t *counter, uint16_t more)
{
    const uint32_t sum = *counter + more;

    *counter = (sum < more) ? UINT32_MAX : sum; /* less: it has wrapped round */
}

/* Move the input on. */
static void advance(scanner_input *input, uint16_t n)
{
    input->bytes = &input->bytes[n];
    input->count = (uint16_t)(input->count - n);
}

/* Skip input up to the next byte that can begin a frame. */
static void hunt(scanner *s, scanner_input *input, uint8_t sync)
{
    const uint8_t *bytes = input->bytes;
    uint16_t left = input->count;

    while ((left > 0U) && (*bytes != sync)) {
        bytes++;
        left--;
    }
    scanner_count(&s->skipped, (uint16_t)(input->count - left));
    input->bytes = bytes;
    input->count = left;
}

/* Take as much input as the next decision needs. Returns whether that was there. */
static bool take(scanner *s, scanner_input *input, const scanner_protocol *protocol)
{
    if (s->needed < protocol->header) {
        s->needed = protocol->header;
    }
    if (s->count == 0U) {
        hunt(s, input, protocol->sync);
    }
    if ((s->count < s->needed) && (input->count > 0U)) {
        uint8_t n = (uint8_t)(s->needed - s->count);

        if (n > input->count) {
            n = (uint8_t)input->count;
        }
        (void)memcpy(&s->bytes[s->count], input->bytes, n);
        advance(input, n);
        s->count = (uint8_t)(s->count + n);
    }
    return s->count >= s->needed;
}

/* Drop the first n bytes held and those behind them that cannot begin a frame. */
static void drop(scanner *s, uint8_t n, uint8_t sync)
{
    uint8_t start = n;

    while ((start < s->count) && (s->bytes[start] != sync)) {
        start++;
    }
    scanner_count(&s->skipped, (uint16_t)start - n);
    s->count = (uint8_t)(s->count - start);
    (void)memmove(s->bytes, &s->bytes[start], s->count);
    s->needed = 0U;
}

/* What is held does not begin with a frame. */
static void reject(scanner *s, uint8_t sync)
{
    scanner_count(&s->skipped, 1U);
    drop(s, 1U, sync);
}

uint8_t scanner_next(scanner *s, scanner_input *input, const scanner_protocol *protocol)
{
    if (s->done != 0U) {
        drop(s, s->done, protocol->sync);
        s->done = 0U;
    }
    while ((s->done == 0U) && take(s, input, protocol)) {
        const uint8_t length = protocol->length(s->bytes);

        if ((length < protocol->header) || (length > SCANNER_SIZE)) {
            reject(s, protocol->sync);
        } else if (s->count < length) {
            s->needed = length;
        } else if (protocol->intact(s->bytes, length)) {
            scanner_count(&s->frames, 1U);
            s->done = length;
        } else {
            scanner_count(&s->errors, 1U);
            reject(s, protocol->sync);
        }
    }
    return s->done;
}

void scanner_abandon(scanner *s)
{
    if ((s->count > 0U) && (s->done == 0U)) {
        scanner_count(&s->skipped, 1U);
        s->done = 1U;
    }
}
