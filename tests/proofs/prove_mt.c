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

/* For all bytes a value is a finite number. */
void prove_value(void)
{
    mt m;
    const uint8_t quantity = nondet_u8();

    __CPROVER_assume(quantity < MT_VALUES);
    const float value = mt_value(&m, (mt_quantity)quantity);
    assert((value >= -FLT_MAX) && (value <= FLT_MAX));
}
