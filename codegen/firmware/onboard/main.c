/* main: the onboard program on its board: a tick every ONBOARD_TICK_MS by the board's clock
 * One late tick is made up for; further missed ones are left out. */
#include "onboard.h"
#include "port.h"

onboard vest;

int main(void)
{
    uint32_t due;

    port_init();
    onboard_init(&vest);
    due = port_clock_ms();
    for (;;) {
        const uint32_t late = port_clock_ms() - due; /* wraps before the tick is due */

        if (late < 0x80000000U) {
            due += (late < (2U * ONBOARD_TICK_MS)) ? ONBOARD_TICK_MS : (late + ONBOARD_TICK_MS);
            onboard_tick(&vest);
        }
    }
}
