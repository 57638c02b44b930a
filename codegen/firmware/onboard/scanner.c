/* scanner: finds the frames in a stream of bytes of which some may be lost, changed or foreign
 * Time: a frame that lies whole in a block is summed once, in place; one in pieces is copied as well. At
 * worst each byte looks like the first of a frame, whose header is read, and each header's length of bytes
 * holds a false frame that is summed in vain. */
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

/* Move the input on over bytes outside all frames. */
static void skip(scanner *s, scanner_input *input, uint16_t n)
{
    scanner_count(&s->skipped, n);
    advance(input, n);
}

/* Skip input up to the next byte that can begin a frame. */
static void hunt(scanner *s, scanner_input *input, uint8_t sync)
{
    uint16_t n = 0U;

    while ((n < input->count) && (input->bytes[n] != sync)) {
        n++;
    }
    if (n > 0U) {
        skip(s, input, n);
    }
}

/* Find a frame that lies whole in the input and move the input on behind it. Returns NULL if there is none:
 * the input then begins with a frame whose rest is missing, or is used up. */
static const uint8_t *search(scanner *s, scanner_input *input, const scanner_protocol *protocol)
{
    const uint8_t *frame = NULL;

    s->needed = 0U;
    while ((frame == NULL) && (s->needed == 0U)) {
        hunt(s, input, protocol->sync);
        if (input->count < protocol->header) {
            s->needed = protocol->header;
        } else {
            const uint8_t length = protocol->length(input->bytes);

            if ((length < protocol->header) || (length > SCANNER_SIZE)) {
                skip(s, input, 1U);
            } else if (input->count < length) {
                s->needed = length;
            } else if (protocol->intact(input->bytes, length)) {
                scanner_count(&s->frames, 1U);
                frame = input->bytes;
                s->length = length;
                advance(input, length);
            } else {
                scanner_count(&s->errors, 1U);
                skip(s, input, 1U);
            }
        }
    }
    return frame;
}

/* Find a frame in the bytes held. */
static const uint8_t *search_held(scanner *s, const scanner_protocol *protocol)
{
    scanner_input held = {&s->bytes[s->start], s->count};
    const uint8_t *const frame = search(s, &held, protocol);

    s->start = (uint8_t)(s->start + s->count - held.count);
    s->count = (uint8_t)held.count;
    return frame;
}

/* Take from the input what the bytes held need to go on. Returns whether there was any. */
static bool top_up(scanner *s, scanner_input *input)
{
    uint8_t n = (uint8_t)(s->needed - s->count);

    if (n > input->count) {
        n = (uint8_t)input->count;
    }
    if (n > 0U) {
        (void)memmove(s->bytes, &s->bytes[s->start], s->count);
        (void)memcpy(&s->bytes[s->count], input->bytes, n);
        s->start = 0U;
        s->count = (uint8_t)(s->count + n);
        advance(input, n);
    }
    return n > 0U;
}

bool scanner_next(scanner *s, scanner_input *input, const scanner_protocol *protocol)
{
    bool more = (s->count > 0U) || (input->count > 0U);

    s->frame = NULL;
    while (more && (s->frame == NULL)) {
        if (s->count > 0U) { /* begun in an earlier block */
            s->frame = search_held(s, protocol);
            more = (s->count == 0U) || (s->frame != NULL) || top_up(s, input);
        } else {
            s->frame = search(s, input, protocol);
            if (s->frame == NULL) { /* less is left than a frame is long */
                (void)top_up(s, input);
                more = false;
            }
        }
    }
    return s->frame != NULL;
}

void scanner_abandon(scanner *s)
{
    if (s->count > 0U) {
        scanner_count(&s->skipped, 1U);
        s->start = (uint8_t)(s->start + 1U);
        s->count = (uint8_t)(s->count - 1U);
    }
}

void scanner_take(scanner *s, uint8_t place, uint8_t length)
{
    const uint8_t end = (uint8_t)(place + length);

    scanner_count(&s->skipped, place);
    scanner_count(&s->frames, 1U);
    s->frame = &s->bytes[s->start + place];
    s->length = length;
    s->start = (uint8_t)(s->start + end);
    s->count = (uint8_t)(s->count - end);
}
