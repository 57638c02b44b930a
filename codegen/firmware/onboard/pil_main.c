/* pil_main: ticks without end on a simulated processor, which is stopped at the two empty functions */
#include "onboard.h"
#include "pil.h"

void pil_wait(void);
void pil_done(void);

int main(void)
{
    pil_start();
    for (;;) {
        pil_wait();
        pil_sent_count = 0U;
        onboard_tick(&vest);
        pil_done();
        pil_record(pil_recorded);
    }
}
