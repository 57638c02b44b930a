/* string: the functions of string.h that the onboard program and its compiler call, for a build without a C
 * library
 * Deviations from MISRA C: the names are reserved (rules 21.1, 21.2), macros have names of functions (5.5),
 * and restrict is in the standard's prototype (8.14), as in any string.h. */
#ifndef STRING_H
#define STRING_H

#include <stddef.h>

void *memcpy(void *restrict to, const void *restrict from, size_t n);
void *memmove(void *to, const void *from, size_t n);
void *memset(void *to, int value, size_t n);

/* Without a C library memcpy is a function like any other. As the compiler's builtin, four bytes of a float
 * take one instruction and no call. */
#define memcpy(to, from, n) __builtin_memcpy((to), (from), (n))
#define memmove(to, from, n) __builtin_memmove((to), (from), (n))
#define memset(to, value, n) __builtin_memset((to), (value), (n))

#endif
