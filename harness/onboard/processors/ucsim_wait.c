/* ucsim_wait: preloaded into ucsim, which sleeps 0.1 s before each command from 2 s after its start on. With
 * this, it wakes as soon as the command comes. */
#include <poll.h>
#include <time.h>

int nanosleep(const struct timespec *duration, struct timespec *rest)
{
    struct pollfd console = {0, POLLIN, 0};

    (void)rest;
    (void)poll(&console, 1, (int)(duration->tv_sec * 1000 + duration->tv_nsec / 1000000));
    return 0;
}
