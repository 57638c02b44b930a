/* siphash: SipHash-2-4
 * Source: Aumasson and Bernstein, SipHash: a fast short-input PRF, INDOCRYPT 2012, 2.1 to 2.4. */
#include "siphash.h"

#include <string.h>

#define WORD 8U /* bytes */
#define LAST (WORD - 1U)

#if UINT_MAX > 0xFFFFU

static uint32_t half(const uint8_t *bytes)
{
    return bytes[0] | ((uint32_t)bytes[1] << 8) | ((uint32_t)bytes[2] << 16) | ((uint32_t)bytes[3] << 24);
}

/* Exclusive or with a word whose lowest byte comes first. */
static void mix(siphash_word *word, const uint8_t *bytes)
{
    *word ^= ((siphash_word)half(&bytes[4]) << 32) | half(bytes);
}

/* The exclusive or of four words, the lowest byte first. */
static void fold(const siphash_word *v, uint8_t *bytes)
{
    siphash_word word = v[0] ^ v[1] ^ v[2] ^ v[3];

    for (uint8_t i = 0U; i < WORD; i++) {
        bytes[i] = (uint8_t)(word & 0xFFU);
        word >>= 8;
    }
}

static siphash_word rotate(siphash_word word, uint8_t bits)
{
    return (word << bits) | (word >> (64U - bits));
}

void siphash_round(siphash_word *v)
{
    v[0] += v[1];
    v[2] += v[3];
    v[1] = rotate(v[1], 13U) ^ v[0];
    v[3] = rotate(v[3], 16U) ^ v[2];
    v[0] = rotate(v[0], 32U) + v[3];
    v[2] += v[1];
    v[1] = rotate(v[1], 17U) ^ v[2];
    v[3] = rotate(v[3], 21U) ^ v[0];
    v[2] = rotate(v[2], 32U);
}

#else

static void mix(siphash_word *word, const uint8_t *bytes)
{
    for (uint8_t i = 0U; i < WORD; i++) {
        word->bytes[i] ^= bytes[i];
    }
}

static void fold(const siphash_word *v, uint8_t *bytes)
{
    for (uint8_t i = 0U; i < WORD; i++) {
        bytes[i] = v[0].bytes[i] ^ v[1].bytes[i] ^ v[2].bytes[i] ^ v[3].bytes[i];
    }
}

#endif

/* Compression (2.2) of so many words, on a copy that a processor can hold in its registers. */
static void compress(siphash *h, const uint8_t *words, uint8_t count)
{
    const uint8_t *word = words;
    siphash_word v[4];

    (void)memcpy(v, h->v, sizeof(v));
    for (uint8_t left = count; left > 0U; left--) {
        mix(&v[3], word);
        siphash_round(v);
        siphash_round(v);
        mix(&v[0], word);
        word = &word[WORD];
    }
    (void)memcpy(h->v, v, sizeof(v));
}

void siphash_begin(siphash *h, const uint8_t *key)
{
    static const uint8_t initial[] = { /* "somepseudorandomlygeneratedbytes", each word turned round */
        0x75, 0x65, 0x73, 0x70, 0x65, 0x6D, 0x6F, 0x73, 0x6D, 0x6F, 0x64, 0x6E, 0x61, 0x72, 0x6F, 0x64,
        0x61, 0x72, 0x65, 0x6E, 0x65, 0x67, 0x79, 0x6C, 0x73, 0x65, 0x74, 0x79, 0x62, 0x64, 0x65, 0x74};

    (void)memset(h, 0, sizeof(*h));
    for (uint8_t i = 0U; i < 4U; i++) {
        mix(&h->v[i], &initial[WORD * i]);
        mix(&h->v[i], &key[WORD * (i & 1U)]);
    }
}

void siphash_take(siphash *h, const uint8_t *bytes, uint8_t count)
{
    uint8_t i = 0U;

    while (i < count) {
        const uint8_t place = h->count & LAST;
        const uint8_t words = (uint8_t)(count - i) / WORD;

        if ((place == 0U) && (words > 0U)) {
            compress(h, &bytes[i], words);
            h->count = (uint8_t)(h->count + (WORD * words));
            i = (uint8_t)(i + (WORD * words));
        } else {
            h->m[place] = bytes[i];
            h->count = (uint8_t)(h->count + 1U);
            i++;
            if (place == LAST) {
                compress(h, h->m, 1U);
            }
        }
    }
}

void siphash_end(siphash *h, uint8_t *tag)
{
    static const uint8_t end[WORD] = {0xFF, 0, 0, 0, 0, 0, 0, 0};

    for (uint8_t i = h->count & LAST; i < LAST; i++) {
        h->m[i] = 0U;
    }
    h->m[LAST] = h->count;
    compress(h, h->m, 1U);
    mix(&h->v[2], end);
    for (uint8_t i = 0U; i < 4U; i++) {
        siphash_round(h->v);
    }
    fold(h->v, tag);
}
