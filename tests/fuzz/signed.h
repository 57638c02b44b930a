/* signed: frames by radio with their tags, made and judged without the program's code
 * The key is that of simulations, the session the first. */
#ifndef SIGNED_H
#define SIGNED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#define SIGNED_OVERHEAD 18U /* bytes of a frame beside its payload */
#define SIGNED_SESSION 1U

static inline uint64_t signed_turn(uint64_t x, unsigned n)
{
    return (x << n) | (x >> (64U - n));
}

static inline void signed_round(uint64_t *a, uint64_t *b, uint64_t *c, uint64_t *d)
{
    *a += *b;
    *b = signed_turn(*b, 13U) ^ *a;
    *a = signed_turn(*a, 32U);
    *c += *d;
    *d = signed_turn(*d, 16U) ^ *c;
    *a += *d;
    *d = signed_turn(*d, 21U) ^ *a;
    *c += *b;
    *b = signed_turn(*b, 17U) ^ *c;
    *c = signed_turn(*c, 32U);
}

/* SipHash-2-4 of bytes and session by the key 00 01 .. 0f. */
static inline uint64_t signed_tag(const uint8_t *bytes, size_t n)
{
    uint64_t v0 = 0x736F6D6570736575U ^ 0x0706050403020100U;
    uint64_t v1 = 0x646F72616E646F6DU ^ 0x0F0E0D0C0B0A0908U;
    uint64_t v2 = 0x6C7967656E657261U ^ 0x0706050403020100U;
    uint64_t v3 = 0x7465646279746573U ^ 0x0F0E0D0C0B0A0908U;
    uint8_t message[512U + 8U] = {0U};
    const size_t whole = 4U + n;

    memcpy(message, bytes, n);
    message[n + 3U] = SIGNED_SESSION;
    for (size_t at = 0U; at <= whole; at += 8U) {
        uint64_t word = ((at + 8U) > whole) ? ((uint64_t)whole << 56) : 0U;

        for (size_t i = 0U; (i < 8U) && ((at + i) < whole); i++) {
            word |= (uint64_t)message[at + i] << (8U * i);
        }
        v3 ^= word;
        signed_round(&v0, &v1, &v2, &v3);
        signed_round(&v0, &v1, &v2, &v3);
        v0 ^= word;
    }
    v2 ^= 0xFFU;
    for (int i = 0; i < 4; i++) {
        signed_round(&v0, &v1, &v2, &v3);
    }
    return v0 ^ v1 ^ v2 ^ v3;
}

static inline uint16_t crc_ccitt(const uint8_t *bytes, size_t n)
{
    unsigned crc = 0xFFFFU;

    for (size_t i = 0U; i < (8U * n); i++) {
        const unsigned bit = ((unsigned)bytes[i / 8U] >> (7U - (i % 8U))) & 1U;

        crc = ((crc << 1) ^ (((crc >> 15) != bit) ? 0x1021U : 0U)) & 0xFFFFU;
    }
    return (uint16_t)crc;
}

static inline uint32_t signed_counter(const uint8_t *frame)
{
    return ((uint32_t)frame[4] << 24) | ((uint32_t)frame[5] << 16) | ((uint32_t)frame[6] << 8) | frame[7];
}

/* Is the CRC of a whole frame right? */
static inline bool signed_intact(const uint8_t *frame)
{
    const size_t end = 16U + (size_t)frame[3];

    return crc_ccitt(&frame[2], end - 2U) == (((unsigned)frame[end] << 8) | frame[end + 1U]);
}

/* And its tag? */
static inline bool signed_genuine(const uint8_t *frame)
{
    const uint64_t tag = signed_tag(&frame[2], 6U + (size_t)frame[3]);
    bool same = true;

    for (size_t i = 0U; i < 8U; i++) {
        same = same && (frame[8U + (size_t)frame[3] + i] == ((tag >> (8U * i)) & 0xFFU));
    }
    return same;
}

/* Put the right CRC behind a frame's tag, and before that the right tag if it is to be genuine. */
static inline void signed_finish(uint8_t *frame, bool genuine)
{
    const size_t end = 16U + (size_t)frame[3];
    const uint64_t tag = signed_tag(&frame[2], end - 10U);
    uint16_t crc;

    for (size_t i = 0U; genuine && (i < 8U); i++) {
        frame[end - 8U + i] = (uint8_t)((tag >> (8U * i)) & 0xFFU);
    }
    crc = crc_ccitt(&frame[2], end - 2U);
    frame[end] = (uint8_t)(crc >> 8);
    frame[end + 1U] = (uint8_t)(crc & 0xFFU);
}

/* An ABORT with a right CRC? */
static inline bool signed_abort(const uint8_t *f)
{
    return (f[0] == 0xA5U) && (f[1] == 0x5AU) && (f[2] == 4U) && (f[3] == 0U) && signed_intact(f);
}

#endif
