/* What the blocks call of a math library, for numbers within 32 bits. */
#ifndef MATH_H
#define MATH_H

float fabsf(float x);
float sqrtf(float x);

static inline float floorf(float x)
{
    const float whole = (float)(long)x;

    return (whole > x) ? (whole - 1.0F) : whole;
}

#endif
