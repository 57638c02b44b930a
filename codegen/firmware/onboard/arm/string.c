/* string: copies and fills, a word at a time
 * The Cortex-M4 reads and writes words at any address (the program leaves UNALIGN_TRP unset), so the two
 * places need not be aligned alike. */
#include "string.h"

#include <stdint.h>

/* A compiler recognises these loops: without this it would make memcpy call itself. */
#if defined(__clang__)
#define NO_CALLS __attribute__((no_builtin))
#else
#define NO_CALLS __attribute__((optimize("no-tree-loop-distribute-patterns")))
#endif

#define BYTES 0x01010101U /* times a byte: a word of it */

/* Four bytes of anything, at any address: the casts to it deviate from MISRA's rule 11.3. */
typedef struct __attribute__((packed, may_alias)) {
    uint32_t value;
} word;

NO_CALLS void *(memcpy)(void *restrict to, const void *restrict from, size_t n)
{
    uint8_t *t = to;
    const uint8_t *f = from;
    size_t left = n;

    while (left >= sizeof(word)) {
        ((word *)t)->value = ((const word *)f)->value; /* cppcheck-suppress misra-c2012-11.3 ; see word */
        t = &t[sizeof(word)];
        f = &f[sizeof(word)];
        left -= sizeof(word);
    }
    while (left > 0U) {
        *t = *f;
        t++;
        f++;
        left--;
    }
    return to;
}

NO_CALLS void *(memmove)(void *to, const void *from, size_t n)
{
    uint8_t *t = to;
    const uint8_t *f = from;

    if (((uintptr_t)t - (uintptr_t)f) >= n) { /* `to` does not begin within what is still to be read */
        (void)(memcpy)(to, from, n);
    } else {
        size_t left = n;

        while (left > 0U) {
            left--;
            t[left] = f[left];
        }
    }
    return to;
}

NO_CALLS void *(memset)(void *to, int value, size_t n)
{
    const uint8_t byte = (uint8_t)value;
    const uint32_t bytes = BYTES * byte;
    uint8_t *t = to;
    size_t left = n;

    while (left >= sizeof(word)) {
        ((word *)t)->value = bytes;
        t = &t[sizeof(word)];
        left -= sizeof(word);
    }
    while (left > 0U) {
        *t = byte;
        t++;
        left--;
    }
    return to;
}
