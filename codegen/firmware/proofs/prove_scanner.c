/* The scanner never leaves its buffers, from any reachable state: its parts with the whole buffer, the
 * search for
 * frames over a few bytes. */
#include "scanner.c"

#include "proof.h"

#define BYTES 8U /* of a block in which frames are searched */

/* Only the places of a copy are checked here, not the bytes. */
void *memcpy(void *to, const void *from, size_t n)
{
    assert(__CPROVER_r_ok(from, n) && __CPROVER_w_ok(to, n));
    return to;
}

void *memmove(void *to, const void *from, size_t n)
{
    assert(__CPROVER_r_ok(from, n) && __CPROVER_w_ok(to, n));
    return to;
}

static bool sane(const scanner *s)
{
    return (s->start <= SCANNER_SIZE) && (s->count <= (SCANNER_SIZE - s->start));
}

/* As search leaves it: more bytes are needed than are held, and there is room for them. */
static bool waiting(const scanner *s)
{
    return (s->needed > s->count) && (s->needed <= SCANNER_SIZE);
}

static scanner any_scanner(void)
{
    scanner s;

    __CPROVER_assume(sane(&s));
    return s;
}

static scanner_input any_input(const uint8_t *bytes, uint16_t size)
{
    scanner_input input = {bytes, nondet_u16()};

    __CPROVER_assume(input.count <= size);
    return input;
}

/* Any protocol whose checksum reads the frame up to its end. */
static uint8_t any_length(const uint8_t *header)
{
    (void)header[3];
    return nondet_u8();
}

static bool any_intact(const uint8_t *frame, uint8_t length)
{
    return frame[length - 1U] == nondet_u8();
}

static const scanner_protocol protocol = {0xB5U, 4U, any_length, any_intact};

void prove_count(void)
{
    uint32_t counter = nondet_u32();
    const uint32_t before = counter;

    scanner_count(&counter, nondet_u16());
    assert(counter >= before);
}

void prove_top_up(void)
{
    uint8_t bytes[512];
    scanner s = any_scanner();
    scanner_input input = any_input(bytes, 512U);
    const uint16_t before = input.count;
    const uint8_t held = s.count;
    bool more;

    __CPROVER_assume(waiting(&s));
    more = top_up(&s, &input);
    assert(sane(&s) && (s.count <= s.needed));
    assert(more == (before > 0U));
    assert(((s.count - held) == (before - input.count)) && (input.bytes == &bytes[before - input.count]));
}

void prove_search(void)
{
    uint8_t bytes[BYTES];
    scanner s = any_scanner();
    scanner_input input = any_input(bytes, BYTES);
    const uint8_t *frame;

    frame = search(&s, &input, &protocol);
    assert(input.count <= BYTES);
    if (frame == NULL) {
        assert((s.needed > input.count) && (s.needed <= SCANNER_SIZE));
    } else {
        assert((frame >= bytes) && (&frame[s.length] == input.bytes));
    }
}

void prove_abandon(void)
{
    scanner s = any_scanner();

    scanner_abandon(&s);
    assert(sane(&s));
}

void prove_take(void)
{
    scanner s = any_scanner();
    const uint8_t place = nondet_u8();
    const uint8_t length = nondet_u8();
    const uint8_t end = (uint8_t)(s.start + s.count);

    __CPROVER_assume((place + length) <= s.count);
    scanner_take(&s, place, length);
    assert(sane(&s) && ((s.start + s.count) == end));
    assert(__CPROVER_r_ok(s.frame, length) && (&s.frame[length] == &s.bytes[s.start]));
}
