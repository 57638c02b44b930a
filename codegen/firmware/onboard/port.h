/* port: what the onboard program needs of its board; written anew for each board
 * None of these functions waits. */
#ifndef PORT_H
#define PORT_H

#include <stdbool.h>
#include <stdint.h>

typedef enum { PORT_GPS, PORT_IMU, PORT_RADIO, PORT_SOURCES } port_source;

void port_init(void);

/* A number that the vest has had after no reset before, and that nobody can choose: it makes recordings of the radio
 * worthless (rule 11). Called once, behind port_init. Good are a count of resets that is kept where
 * the power is not needed, a clock that always goes, or 32 bits of true noise: with n recorded sessions one of them
 * then fits once in 2^32 / n resets. */
uint32_t port_session(void);

/* ms since power-up; begins again from 0 after 2^32. */
uint32_t port_clock_ms(void);

#define PORT_MOST 512U /* bytes that port_receive gives at once, at most */

/* Take bytes that have come from a source: `bytes` is set to the oldest; returns how many can be read from
 * there on. They stay in place until the next call for the same source. */
uint16_t port_receive(port_source source, const uint8_t **bytes);

/* Send bytes to the operator; they are copied before the function returns. */
void port_send(const uint8_t *bytes, uint16_t count);

/* What the board measures of itself, asked for with each telemetry: the last reading, since nothing waits here. A
 * board that cannot tell keeps no trial from beginning. */
uint16_t port_battery_mv(void); /* 0: not told */
int16_t port_temperature(void); /* 0.1 deg C, of the pack */

#define PORT_NO_TEMPERATURE INT16_MIN /* not told */

/* Play a tone [Hz], 0 for none, and set the two vibrators. */
void port_command_module(uint16_t tone_hz, bool vibrate_left, bool vibrate_right);

#endif
