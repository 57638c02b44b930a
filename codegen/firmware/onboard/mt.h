/* mt: inertial, magnetic and attitude samples from an Xsens MT
 * Source: Xsens MT low-level communication protocol, message MTData; Miller 2010, 2.3 (MTi-X).
 *
 * The unit is set to output mode 0x0006 (calibrated data and orientation) and settings 0x00000005 (Euler
 * angles and sample counter, single precision). Values pass unchanged, but NaN and infinity become the
 * greatest float: the estimator knows the ranges, and refuses it like any other value out of range. */
#ifndef MT_H
#define MT_H

#include "scanner.h"

#define MT_VALUES 12U

/* The values of a sample, in the axes of the body: forward, right, down. */
typedef enum {
    MT_ACCEL_X, /* m/s2, specific force */
    MT_ACCEL_Y,
    MT_ACCEL_Z,
    MT_GYRO_X, /* rad/s */
    MT_GYRO_Y,
    MT_GYRO_Z,
    MT_MAG_X, /* in units of the field where the unit was calibrated */
    MT_MAG_Y,
    MT_MAG_Z,
    MT_ROLL,   /* rad, right side down positive */
    MT_PITCH,  /* rad, nose up positive */
    MT_HEADING /* rad, clockwise from north */
} mt_quantity;

typedef struct {
    scanner scanner;
    bool z_up;                      /* its axes: forward, left, up; yaw counter-clockwise, pitch nose down */
    bool sampled;                   /* there has been a sample */
    uint8_t values[4U * MT_VALUES]; /* the last sample as it came; converted only where read */
    uint16_t counter;               /* of samples, by the unit */
    uint32_t lost;                  /* samples that the counter skipped; stops at its greatest value */
} mt;

void mt_init(mt *m, bool z_up);

/* Read up to the next sample whose counter has moved. Returns false when the input is used up: call until
 * then. */
bool mt_receive(mt *m, scanner_input *input);

/* A value of the last sample. */
float mt_value(const mt *m, mt_quantity quantity);

#endif
