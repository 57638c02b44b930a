/* A block as a functional mock-up unit: the part that FMI 2.0 and FMI 3.0 share.
 *
 * fmi2.c and fmi3.c translate each version's functions into these; block_fmu.h, generated, says what block
 * it is. Functions return false when they refuse, after a message that says what was got and expected. */
#ifndef SHIM_H
#define SHIM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum { MESSAGE_SIZE = 512 }; /* bytes; longer messages are cut */

typedef struct Instance Instance;
typedef void (*Callback)(void); /* the environment's logger, whatever its true type */
typedef void (*Report)(const Instance *m, const char *message);

/* An instance in mode "instantiated", or NULL with a message: wrong token, no memory. */
Instance *shim_instantiate(const char *function, const char *name, const char *token, Report report,
                           Callback logger, void *environment);
void shim_free(Instance *m);
const char *shim_name(const Instance *m);
Callback shim_logger(const Instance *m);
void *shim_environment(const Instance *m);

/* Refuse a function that this unit lacks; its other arguments do not matter. */
bool shim_lacks(const Instance *m, const char *function, ...);
bool shim_same_count(const Instance *m, const char *function, size_t references, size_t values);

/* `stop` is HUGE_VAL when there is none. */
bool shim_setup(Instance *m, const char *function, double start, double stop);
bool shim_enter_initialization(Instance *m, const char *function);
bool shim_exit_initialization(Instance *m, const char *function);
bool shim_step(Instance *m, const char *function, double point, double size);
bool shim_terminate(Instance *m, const char *function);
bool shim_reset(Instance *m);
double shim_time(const Instance *m); /* s, the communication point reached */

bool shim_get_real(Instance *m, const char *function, uint32_t reference, double *value);
bool shim_get_integer(Instance *m, const char *function, uint32_t reference, int32_t *value);
bool shim_get_boolean(Instance *m, const char *function, uint32_t reference, bool *value);
bool shim_set_real(Instance *m, const char *function, uint32_t reference, double value);
bool shim_set_integer(Instance *m, const char *function, uint32_t reference, int32_t value);
bool shim_set_boolean(Instance *m, const char *function, uint32_t reference, bool value);

/* `*state` is NULL (then memory is provided) or from an earlier call. */
bool shim_get_state(const Instance *m, const char *function, void **state);
bool shim_set_state(Instance *m, const char *function, const void *state);
bool shim_free_state(void **state);
size_t shim_serialized_size(void);
bool shim_serialize(const Instance *m, const char *function, const void *state, uint8_t bytes[], size_t size);
bool shim_deserialize(const Instance *m, const char *function, const uint8_t bytes[], size_t size, void **state);

#endif
