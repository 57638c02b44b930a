/* mt: inertial, magnetic and attitude samples from an Xsens MT
 * Source: Xsens MT low-level communication protocol, message MTData; Miller 2010, 2.3 (MTi-X).
 *
 * The unit is set to output mode 0x0006 (calibrated data and orientation) and settings 0x00000005 (Euler
 * angles and sample counter, single precision). Its values pass as they are, but what is no finite number
 * becomes the greatest one: the estimator, which knows their ranges, refuses it as it does others. */
#ifndef MT_H
#define MT_H

#include "scanner.h"

/* Axes of the body: forward, right, down. */
typedef struct {
    float accel[3];   /* m/s2, specific force */
    float gyro[3];    /* rad/s */
    float mag[3];     /* in units of the field where the unit was calibrated */
    float roll;       /* rad, right side down positive */
    float pitch;      /* rad, nose up positive */
    float heading;    /* rad, clockwise from north */
    uint16_t counter; /* of samples, by the unit */
} mt_sample;

typedef struct {
    scanner scanner;
    bool z_up;        /* the unit's axes: forward, left, up; yaw counter-clockwise, pitch nose down */
    bool sampled;     /* there has been a sample */
    mt_sample sample; /* the last one */
    uint32_t lost;    /* samples that the counter jumped over; stops at its greatest value */
} mt;

void mt_init(mt *m, bool z_up);

/* Read up to the end of the next frame. Returns true with a new sample, false when the input is used up: call
 * until then. */
bool mt_receive(mt *m, scanner_input *input);

#endif
