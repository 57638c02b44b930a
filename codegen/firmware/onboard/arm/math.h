/* math: the functions of math.h that the onboard program calls, for a build without a C library
 * All are exact by IEEE 754, in single precision, the only one that the Cortex-M4F computes in. */
#ifndef MATH_H
#define MATH_H

#include <stdint.h>

#define FLOAT_WHOLE 8388608.0f /* 2^23: from here on every float is whole */

static inline float fabsf(float x)
{
    return __builtin_fabsf(x);
}

/* The processor's own instruction, which is correctly rounded. It is written in assembly: a compiler that
 * has to set errno makes its builtin call sqrtf, which is this function. */
static inline float sqrtf(float x)
{
    float root;

    __asm__("vsqrt.f32 %0, %1" : "=t"(root) : "t"(x));
    return root;
}

/* The greatest whole number that is not above x; zeros, infinities and NaN stay what they are. */
static inline float floorf(float x)
{
    float whole = x;

    if (fabsf(x) < FLOAT_WHOLE) { /* false for NaN */
        const float truncated = (float)(int32_t)x;

        if (truncated > x) {
            whole = truncated - 1.0f;
        } else if (truncated < x) {
            whole = truncated;
        } else {
            /* whole already; truncated would lose the sign of -0 */
        }
    }
    return whole;
}

#endif
