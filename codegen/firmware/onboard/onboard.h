/* onboard: the program on the vest: drivers, estimator, controller and command module, 25 times a second
 * Source: Miller 2010, 2.3, 2.4, Chapters 3 and 4. */
#ifndef ONBOARD_H
#define ONBOARD_H

#include "cmec.h"
#include "command_module.h"
#include "four_state.h"
#include "link.h"
#include "local_plane.h"
#include "models.h"
#include "mt.h"
#include "ubx.h"
#include "watchdog.h"

#define ONBOARD_BLOCKS 2U /* of up to PORT_MOST bytes, read from a source in a tick; the rest waits */

#ifndef ONBOARD_IMU_Z_UP
#define ONBOARD_IMU_Z_UP true /* axes of the inertial unit: see mt.h */
#endif

/* All that the program remembers. */
typedef struct {
    uint32_t time_ms;    /* since the start, in whole ticks */
    ubx gps;
    mt imu;
    radio_link radio;
    bool start_wanted;   /* a START has come whose trial has not begun yet */
    uint16_t mission_id; /* of the mission that was begun last */
    uint8_t pause;       /* ticks without a byte from the radio */
    bool busy;           /* radio and telemetry waited on the last tick */
    bool reporting;      /* telemetry is due */
    uint8_t sequence;    /* of the next telemetry */
    local_plane local_plane;
    four_state estimator;
    watchdog watchdog;
    cmec controller;
    command_module command_module;
} onboard;

void onboard_init(onboard *m);

/* One tick: read the sources, estimate, decide, command, report. Call it every ONBOARD_TICK_MS. */
void onboard_tick(onboard *m);

/* Set the blocks' parameters (parameters.c). */
void onboard_parameters(onboard *m);

#endif
