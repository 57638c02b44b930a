/* mt: inertial, magnetic and attitude samples from an Xsens MT
 * Source: Xsens MT low-level communication protocol, message MTData; Miller 2010, 2.3 (MTi-X).
 * A frame: FA, FF (bus address), message, length of the data, data, checksum. Big-endian. */
#include "mt.h"

#include <string.h>

#define PREAMBLE 0xFAU
#define ADDRESS 0xFFU
#define MTDATA 0x32U
#define DATA 50U /* bytes: twelve floats and the counter */
#define HEADER 4U
#define CHECKSUM 1U

#define SIGN 0x80000000U      /* of an IEEE 754 float */
#define INFINITE 0xFF000000U  /* a float shifted past its sign: from here on infinity or NaN */
#define GREATEST 0x7F7FFFFFU  /* FLT_MAX */
#define RADIANS 0.0174532925F /* rad/deg */

static uint8_t mt_length(const uint8_t *header)
{
    const bool expected = (header[1] == ADDRESS) && (header[2] == MTDATA) && (header[3] == DATA);

    return expected ? (uint8_t)(HEADER + DATA + CHECKSUM) : 0U;
}

/* The 54 bytes behind the preamble, checksum included, sum up to 0. Six are added at a time. */
static bool mt_intact(const uint8_t *frame, uint8_t length)
{
    const uint8_t *byte = &frame[1];
    const uint8_t *const end = &frame[length];
    uint8_t sum = 0U;

    while (byte < end) {
        sum = (uint8_t)(sum + byte[0] + byte[1] + byte[2] + byte[3] + byte[4] + byte[5]);
        byte = &byte[6];
    }
    return sum == 0U;
}

/* A float, its sign changed where `flip` is SIGN. The bit is flipped instead of negating the number, which
 * takes hundreds of clocks on a processor without floating point. NaN and infinity become the greatest
 * float, which is out of every range. */
static float get_float(const uint8_t *bytes, uint32_t flip)
{
    const uint32_t bits =
        ((uint32_t)bytes[0] << 24) | ((uint32_t)bytes[1] << 16) | ((uint32_t)bytes[2] << 8) | bytes[3];
    const uint32_t finite = ((bits << 1) >= INFINITE) ? GREATEST : (bits ^ flip);
    float value;

    /* cppcheck-suppress misra-c2012-21.15 ; deviation: the bits of a float are meant, not its value */
    (void)memcpy(&value, &finite, sizeof(value));
    return value;
}

/* Count the samples that the counter skipped. A step back means that the unit was restarted. */
static void count_lost(mt *m, uint16_t counter)
{
    const uint16_t gap = (uint16_t)((uint16_t)(counter - m->counter) - 1U);

    if (m->sampled && (gap <= (uint16_t)INT16_MAX)) {
        scanner_count(&m->lost, gap);
    }
}

void mt_init(mt *m, bool z_up)
{
    (void)memset(m, 0, sizeof(*m));
    m->z_up = z_up;
}

/* Take the sample that the scanner holds. Returns whether it is a new one: the counter has moved. */
static bool take_sample(mt *m)
{
    const uint8_t *const data = &m->scanner.frame[HEADER];
    const uint8_t *const end = &data[sizeof(m->values)];
    const uint16_t counter = (uint16_t)(((uint16_t)end[0] << 8) | end[1]);
    const bool fresh = !m->sampled || (counter != m->counter);

    if (fresh) {
        (void)memcpy(m->values, data, sizeof(m->values));
        count_lost(m, counter);
        m->counter = counter;
        m->sampled = true;
    }
    return fresh;
}

bool mt_receive(mt *m, scanner_input *input)
{
    static const scanner_protocol protocol = {PREAMBLE, HEADER, mt_length, mt_intact};
    bool fresh = false;

    while (!fresh && scanner_next(&m->scanner, input, &protocol)) {
        fresh = take_sample(m);
    }
    return fresh;
}

float mt_value(const mt *m, mt_quantity quantity)
{
    static const bool opposite[MT_VALUES] = { /* the sign in z-up axes */
        false, true, true, false, true, true, false, true, true, false, true, true
    };
    const uint32_t flip = (m->z_up && opposite[quantity]) ? SIGN : 0U;
    const float value = get_float(&m->values[4U * (uint8_t)quantity], flip);

    return (quantity >= MT_ROLL) ? (RADIANS * value) : value;
}
