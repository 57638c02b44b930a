/* Whole trials in C, for many seeds: the wirings `cts` and `full` stepped in sequential order. */
#include "canine.h"
#include "cmec.h"
#include "four_state.h"
#include "sensors.h"

void cts(canine *plant, cmec *controller, int32_t seed, int32_t ticks, int32_t *outcome);
void full(canine *plant, sensors *sensing, four_state *estimator, cmec *controller, int32_t seed, int32_t ticks,
          int32_t *outcome);

/* outcome: status, ticks taken, directional commands */
static void conclude(const cmec *controller, int32_t tick, int32_t *outcome)
{
    outcome[0] = controller->out.status;
    outcome[1] = tick;
    outcome[2] = controller->out.directional_commands;
}

static void prepare(canine *plant, cmec *controller, int32_t seed)
{
    plant->par.seed = seed;
    plant->in.command = 0;
    canine_initialize(plant);
    cmec_initialize(controller);
    controller->in.start = true;
    controller->in.link_ok = true;
    controller->in.valid = true;
}

void cts(canine *plant, cmec *controller, int32_t seed, int32_t ticks, int32_t *outcome)
{
    int32_t tick;
    prepare(plant, controller, seed);
    for (tick = 0; tick < ticks; tick++) {
        controller->in.north = plant->out.north;
        controller->in.east = plant->out.east;
        controller->in.speed = plant->out.speed;
        controller->in.heading = plant->out.heading;
        cmec_step(controller);
        if (controller->out.status >= CMEC_STATUS_SUCCESS) {
            break;
        }
        plant->in.command = controller->out.command;
        canine_step(plant);
    }
    conclude(controller, tick, outcome);
}

void full(canine *plant, sensors *sensing, four_state *estimator, cmec *controller, int32_t seed, int32_t ticks,
          int32_t *outcome)
{
    int32_t tick;
    prepare(plant, controller, seed);
    sensing->par.seed = seed;
    sensors_initialize(sensing);
    four_state_initialize(estimator);
    for (tick = 0; tick < ticks; tick++) {
        sensing->in.north = plant->out.north;
        sensing->in.east = plant->out.east;
        sensing->in.speed = plant->out.speed;
        sensing->in.heading = plant->out.heading;
        sensing->in.acceleration = plant->out.acceleration;
        sensing->in.pitch = plant->out.pitch;
        sensing->in.roll = plant->out.roll;
        sensing->in.yaw_rate = plant->out.yaw_rate;
        sensors_step(sensing);
        estimator->in.accel_x = sensing->out.accel_x;
        estimator->in.pitch_meas = sensing->out.pitch_meas;
        estimator->in.heading_meas = sensing->out.heading_meas;
        estimator->in.gps_fix = sensing->out.gps_fix;
        estimator->in.gps_north = sensing->out.gps_north;
        estimator->in.gps_east = sensing->out.gps_east;
        estimator->in.gps_speed = sensing->out.gps_speed;
        estimator->in.gps_h_acc = sensing->out.gps_h_acc;
        estimator->in.gps_s_acc = sensing->out.gps_s_acc;
        four_state_step(estimator);
        controller->in.north = estimator->out.north;
        controller->in.east = estimator->out.east;
        controller->in.speed = estimator->out.speed;
        controller->in.heading = estimator->out.heading;
        controller->in.valid = estimator->out.valid;
        cmec_step(controller);
        if (controller->out.status >= CMEC_STATUS_SUCCESS) {
            break;
        }
        plant->in.command = controller->out.command;
        canine_step(plant);
    }
    conclude(controller, tick, outcome);
}
