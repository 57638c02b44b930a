/* proof: arbitrary values */
#ifndef PROOF_H
#define PROOF_H

#include <assert.h>
#include <math.h>
#include <stdbool.h>
#include <stdint.h>

bool nondet_bool(void);
uint8_t nondet_u8(void);
uint16_t nondet_u16(void);
uint32_t nondet_u32(void);
int16_t nondet_i16(void);
int32_t nondet_i32(void);
float nondet_float(void);

static inline float float_in(float low, float high)
{
    const float value = nondet_float();

    __CPROVER_assume((value >= low) && (value <= high));
    return value;
}

static inline int16_t short_in(int16_t low, int16_t high)
{
    const int16_t value = nondet_i16();

    __CPROVER_assume((value >= low) && (value <= high));
    return value;
}

static inline int32_t int_in(int32_t low, int32_t high)
{
    const int32_t value = nondet_i32();

    __CPROVER_assume((value >= low) && (value <= high));
    return value;
}

#endif
