/* aeabi: the names by which compilers for ARM call memcpy, memmove and memset
 * Source: Run-time ABI for the ARM Architecture, 5.3.4. A 4 or 8 in the name promises that alignment. */
#include "string.h"

#define FORWARD_COPY(name, function)                                                       \
    void(name)(void *to, const void *from, size_t n);                                       \
    void(name)(void *to, const void *from, size_t n)                                        \
    {                                                                                      \
        (void)(function)(to, from, n);                                                     \
    }

/* The order of the arguments is not that of memset. */
#define FORWARD_SET(name)                                                                  \
    void(name)(void *to, size_t n, int value);                                              \
    void(name)(void *to, size_t n, int value)                                               \
    {                                                                                      \
        (void)(memset)(to, value, n);                                                      \
    }

#define FORWARD_CLEAR(name)                                                                \
    void(name)(void *to, size_t n);                                                         \
    void(name)(void *to, size_t n)                                                          \
    {                                                                                      \
        (void)(memset)(to, 0, n);                                                          \
    }

FORWARD_COPY(__aeabi_memcpy, memcpy)
FORWARD_COPY(__aeabi_memcpy4, memcpy)
FORWARD_COPY(__aeabi_memcpy8, memcpy)
FORWARD_COPY(__aeabi_memmove, memmove)
FORWARD_COPY(__aeabi_memmove4, memmove)
FORWARD_COPY(__aeabi_memmove8, memmove)
FORWARD_SET(__aeabi_memset)
FORWARD_SET(__aeabi_memset4)
FORWARD_SET(__aeabi_memset8)
FORWARD_CLEAR(__aeabi_memclr)
FORWARD_CLEAR(__aeabi_memclr4)
FORWARD_CLEAR(__aeabi_memclr8)
