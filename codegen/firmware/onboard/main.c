/* main: the onboard program on its board: a tick every 40 ms by the board's clock
 * A tick that comes late is made up for; more than one missed is not. */
#include "onboard.h"
#include "port.h"

int main(void)
{
    static onboard vest;
    uint32_t due;

    port_init();
    onboard_init(&vest);
    due = port_clock_ms();
    for (;;) {
        const uint32_t late = port_clock_ms() - due; /* before it is due: more than 2^31 */

        if (late < 0x80000000U) {
            due += (late < (2U * ONBOARD_TICK_MS)) ? ONBOARD_TICK_MS : (late + ONBOARD_TICK_MS);
            onboard_tick(&vest);
        }
    }
}
