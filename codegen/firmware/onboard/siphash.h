/* siphash: SipHash-2-4, a tag of 64 bits over bytes that only the owner of a key of 128 bits can make
 * Source: Aumasson and Bernstein, SipHash: a fast short-input PRF, INDOCRYPT 2012, 2.1 to 2.4.
 *
 * How long it takes depends on the number of bytes alone, neither on them nor on the key. */
#ifndef SIPHASH_H
#define SIPHASH_H

#include <limits.h>
#include <stdint.h>

#define SIPHASH_TAG 8U /* bytes */

#if UINT_MAX > 0xFFFFU
typedef uint64_t siphash_word;
#else /* a small processor has no numbers of 64 bits: their bytes, the lowest first */
typedef struct {
    uint8_t bytes[8];
} siphash_word;
#endif

typedef struct {
    siphash_word v[4];
    uint8_t m[8];  /* the word of the message that is being filled */
    uint8_t count; /* of the message's bytes, modulo 256 */
} siphash;

/* The key has 16 bytes. */
void siphash_begin(siphash *h, const uint8_t *key);

/* Take the message's next bytes. */
void siphash_take(siphash *h, const uint8_t *bytes, uint8_t count);

/* Write the tag of all bytes taken: SIPHASH_TAG bytes. */
void siphash_end(siphash *h, uint8_t *tag);

/* SipRound (2.3) on four words. A small processor's is its own (sipround.s). */
void siphash_round(siphash_word *v);

#endif
