/* The sizes of the drivers' structs, by which the tests see that they lay them out as the compiler does. */
#include "link.h"
#include "mt.h"
#include "ubx.h"

#include <stddef.h>

const size_t SIZES[] = {
    sizeof(scanner_input), sizeof(scanner), /* scanner.h */
    sizeof(ubx_fix), sizeof(ubx), /* ubx.h */
    sizeof(mt), /* mt.h */
    sizeof(link_position), sizeof(link_mission), sizeof(radio_link), sizeof(link_telemetry), /* link.h */
};
