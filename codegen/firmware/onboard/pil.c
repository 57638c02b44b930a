/* pil: the onboard program as processor in the loop: a mailbox takes the place of the board
 * The harness stops the program at pil_wait and writes the bytes of each source. After the tick it reads the
 * bytes sent, the tone and vibrators, and the record of everything that the program remembers. */
#include "onboard.h"
#include "pil.h"
#include "port.h"

#include <string.h>

uint8_t pil_received[PORT_SOURCES][PIL_SIZE];
uint16_t pil_counts[PORT_SOURCES];
uint8_t pil_sent[PIL_SIZE];
uint16_t pil_sent_count;
uint16_t pil_tone_hz;
uint8_t pil_vibrate_left;
uint8_t pil_vibrate_right;
uint32_t pil_recorded[PIL_WORDS];
uint32_t pil_session = 1U;
uint16_t pil_battery_mv;
int16_t pil_temperature = PORT_NO_TEMPERATURE;

onboard vest;

void port_init(void)
{
}

uint32_t port_session(void)
{
    return pil_session;
}

uint32_t port_clock_ms(void)
{
    return vest.time_ms;
}

uint16_t port_receive(port_source source, const uint8_t **bytes)
{
    const uint16_t count = pil_counts[source];

    *bytes = pil_received[source];
    pil_counts[source] = 0U;
    return count;
}

void port_send(const uint8_t *bytes, uint16_t count)
{
    if (count <= (uint16_t)(PIL_SIZE - pil_sent_count)) {
        (void)memcpy(&pil_sent[pil_sent_count], bytes, count);
        pil_sent_count = (uint16_t)(pil_sent_count + count);
    }
}

uint16_t port_battery_mv(void)
{
    return pil_battery_mv;
}

int16_t port_temperature(void)
{
    return pil_temperature;
}

void port_command_module(uint16_t tone_hz, bool vibrate_left, bool vibrate_right)
{
    pil_tone_hz = tone_hz;
    pil_vibrate_left = vibrate_left ? 1U : 0U;
    pil_vibrate_right = vibrate_right ? 1U : 0U;
}

void pil_start(void)
{
    onboard_init(&vest);
    pil_record(pil_recorded);
}

void pil_tick(void)
{
    pil_sent_count = 0U;
    onboard_tick(&vest);
    pil_record(pil_recorded);
}
