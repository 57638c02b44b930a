/* endless: a board whose sources never run dry; what the radio gives first may be chosen */
#include "onboard.h"
#include "port.h"

#include <stddef.h>

#define ENOUGH 100U /* blocks: a program that reads on and on comes back, too */

extern uint32_t blocks_given[PORT_SOURCES];
extern uint16_t block_size;
extern uint8_t first_block[PORT_MOST];

uint32_t blocks_given[PORT_SOURCES];
uint16_t block_size;
uint8_t first_block[PORT_MOST];
onboard vest;

uint32_t port_session(void)
{
    return 1U;
}

uint16_t port_receive(port_source source, const uint8_t **bytes)
{
    static const uint8_t noise[PORT_MOST];

    blocks_given[source]++;
    *bytes = ((source == PORT_RADIO) && (blocks_given[source] == 1U)) ? first_block : noise;
    return (blocks_given[source] < ENOUGH) ? block_size : 0U;
}

void port_send(const uint8_t *bytes, uint16_t count)
{
    (void)bytes;
    (void)count;
}

uint16_t port_battery_mv(void)
{
    return 0U;
}

int16_t port_temperature(void)
{
    return PORT_NO_TEMPERATURE;
}

void port_command_module(uint16_t tone_hz, bool vibrate_left, bool vibrate_right)
{
    (void)tone_hz;
    (void)vibrate_left;
    (void)vibrate_right;
}
