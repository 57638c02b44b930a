/* shipped: parameters as the firmware sets them */
#ifndef SHIPPED_H
#define SHIPPED_H

#include "parameters.c"

static onboard shipped(void)
{
    onboard m;

    onboard_parameters(&m);
    return m;
}

#endif
