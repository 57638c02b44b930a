/* What the proofs of the rules assume of a state: it holds where the program starts, and behind any tick. */
#include "controller.h"

void prove_start(void)
{
    (void)started();
}

void prove_tick(void)
{
    cmec m = any_controller(nondet_bool());

    cmec_step(&m);
    assert(possible(&m));
}
