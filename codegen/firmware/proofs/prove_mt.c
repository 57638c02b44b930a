/* The inertial unit's frames: no access beyond them. */
#include "mt.c"

#include "proof.h"

#include <float.h>

/* Finds any frame of the protocol's length, or none: prove_scanner.c proves this of the scanner. Two at most. */
bool scanner_next(scanner *s, scanner_input *input, const scanner_protocol *protocol)
{
    static uint8_t frame[SCANNER_SIZE];
    static uint8_t found = 0U;

    (void)input;
    __CPROVER_havoc_object(frame);
    s->frame = frame;
    s->length = protocol->length(frame);
    found++;
    return (s->length != 0U) && (found <= 2U) && nondet_bool();
}

void scanner_count(uint32_t *counter, uint16_t more)
{
    *counter = (*counter > (UINT32_MAX - more)) ? UINT32_MAX : (*counter + more);
}

void prove_length(void)
{
    uint8_t header[HEADER];
    const uint8_t length = mt_length(header);

    assert((length == 0U) || (length == 55U));
}

void prove_intact(void)
{
    uint8_t frame[55];

    (void)mt_intact(frame, 55U);
}

void prove_receive(void)
{
    mt m;
    scanner_input input;
    const uint32_t lost = m.lost;

    if (mt_receive(&m, &input)) {
        assert(m.sampled);
    }
    assert(m.lost >= lost);
}

/* A sample is new if its counter has moved; then all of it is taken, and those between are counted as lost. */
void prove_sample(void)
{
    mt m;
    const mt before = m;
    uint8_t frame[55];
    const uint8_t place = nondet_u8();
    const uint16_t counter = (uint16_t)(((uint16_t)frame[52] << 8) | frame[53]);
    const uint16_t step = (uint16_t)(counter - before.counter);
    bool fresh;

    __CPROVER_assume(place < sizeof(m.values));
    m.scanner.frame = frame;
    m.sampled = nondet_bool();
    const bool sampled = m.sampled;
    fresh = take_sample(&m);
    assert(fresh == (!sampled || (step != 0U)));
    assert(m.sampled && (m.counter == counter));
    assert(m.values[place] == (fresh ? frame[HEADER + place] : before.values[place]));
    if (sampled && (step >= 1U) && (step <= 32768U)) {
        assert((m.lost == UINT32_MAX) || (m.lost == (before.lost + step - 1U)));
    } else {
        assert(m.lost == before.lost);
    }
}

/* For all bytes a value is a finite number. */
void prove_value(void)
{
    mt m;
    const uint8_t quantity = nondet_u8();

    __CPROVER_assume(quantity < MT_VALUES);
    const float value = mt_value(&m, (mt_quantity)quantity);
    assert((value >= -FLT_MAX) && (value <= FLT_MAX));
}
