#include "shim.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef enum { REAL, REAL32, INTEGER, BOOLEAN } Type; /* REAL32: a float in the block, a double outside */
typedef enum { INPUT, OUTPUT, FIXED, TUNABLE, STATE, TIME } Role;
typedef enum { INSTANTIATED = 1, INITIALIZATION = 2, STEPPING = 4, TERMINATED = 8 } Mode; /* or-ed: allowed */

typedef struct {
    const char *name;
    size_t offset; /* in Snapshot */
    Type type;
    Role role;
    double min, max; /* of a parameter */
} Variable;

#include "block_fmu.h" /* Block, BLOCK_*, Snapshot and its variables[] in the order of their references */

struct Instance {
    Snapshot now; /* first, so that it is aligned; everything that a saved state brings back */
    double stop;  /* s */
    Report report;
    Callback logger;
    void *environment;
    char name[];
};

enum { VARIABLES = sizeof variables / sizeof variables[0], ANY = 15 };
static const double step_tolerance = 1e-6; /* of the sample time */
static const double most_ticks = 1e9; /* in one step: longer ones are no multiple within the tolerance */
static const double point_tolerance = 1e-3; /* of the sample time: masters that add up steps drift */

static bool complain(const Instance *m, const char *format, ...)
{
    char message[MESSAGE_SIZE];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    if (m->report) {
        m->report(m, message);
    }
    return false;
}

static const char *mode_name(int mode)
{
    return mode == INSTANTIATED ? "instantiated" : mode == INITIALIZATION ? "initialization"
         : mode == STEPPING ? "step" : "terminated";
}

static bool allowed(const Instance *m, const char *function, int modes)
{
    if (!m) {
        return false;
    }
    if (m->now.mode & modes) {
        return true;
    }
    return complain(m, "%s: %s is in mode \"%s\", which does not allow it", function, BLOCK_NAME,
                    mode_name(m->now.mode));
}

static void start(Instance *m)
{
    memset(&m->now, 0, sizeof m->now);
    block_defaults(&m->now.block);
    m->now.mode = INSTANTIATED;
    m->stop = HUGE_VAL;
}

Instance *shim_instantiate(const char *function, const char *name, const char *token, Report report,
                           Callback logger, void *environment)
{
    const size_t length = name ? strlen(name) : 0;
    Instance *m = calloc(1, sizeof *m + length + 1);
    if (!m) {
        return NULL;
    }
    if (length) {
        memcpy(m->name, name, length);
    }
    m->report = logger ? report : NULL;
    m->logger = logger;
    m->environment = environment;
    start(m);
    if (!token || strcmp(token, BLOCK_TOKEN) != 0) {
        complain(m, "%s: %s expected the token \"%s\" of its own model description, got \"%s\"", function,
                 BLOCK_NAME, BLOCK_TOKEN, token ? token : "");
        free(m);
        return NULL;
    }
    return m;
}

void shim_free(Instance *m)
{
    free(m);
}

const char *shim_name(const Instance *m)
{
    return m->name;
}

Callback shim_logger(const Instance *m)
{
    return m->logger;
}

void *shim_environment(const Instance *m)
{
    return m->environment;
}

bool shim_lacks(const Instance *m, const char *function, ...)
{
    return allowed(m, function, ANY)
        && complain(m, "%s: %s does not support it; see the capabilities in its model description", function,
                    BLOCK_NAME);
}

bool shim_same_count(const Instance *m, const char *function, size_t references, size_t values)
{
    return allowed(m, function, ANY)
        && (references == values
            || complain(m, "%s: got room for %zu values, expected %zu: every variable of %s is a scalar", function,
                        values, references, BLOCK_NAME));
}

bool shim_setup(Instance *m, const char *function, double start_time, double stop_time)
{
    if (!allowed(m, function, INSTANTIATED)) {
        return false;
    }
    if (!isfinite(start_time) || !(stop_time >= start_time)) {
        return complain(m, "%s: start time %.16g and stop time %.16g; expected a finite start and no stop before it",
                        function, start_time, stop_time);
    }
    m->now.start = m->now.time = start_time;
    m->stop = stop_time;
    return true;
}

bool shim_enter_initialization(Instance *m, const char *function)
{
    if (!allowed(m, function, INSTANTIATED)) {
        return false;
    }
    m->now.mode = INITIALIZATION;
    m->now.stale = true;
    return true;
}

/* The block's states follow its parameters until initialization ends. */
static void refresh(Instance *m)
{
    if (m->now.mode == INITIALIZATION && m->now.stale) {
        block_initialize(&m->now.block);
        m->now.stale = false;
    }
}

bool shim_exit_initialization(Instance *m, const char *function)
{
    if (!allowed(m, function, INITIALIZATION)) {
        return false;
    }
    refresh(m);
    m->now.mode = STEPPING;
    return true;
}

bool shim_step(Instance *m, const char *function, double point, double size)
{
    if (!allowed(m, function, STEPPING)) {
        return false;
    }
    if (!(fabs(point - m->now.time) <= point_tolerance * BLOCK_SAMPLE_TIME)) {
        return complain(m, "%s: communication point: expected %.16g, got %.16g", function, m->now.time, point);
    }
    if (size >= 0 && size <= step_tolerance * BLOCK_SAMPLE_TIME) {
        return true; /* some masters end a run, or an event, with a step of nothing */
    }
    const double ticks = BLOCK_TAKES_ANY_STEP ? size > 0 && size < HUGE_VAL : floor(size / BLOCK_SAMPLE_TIME + 0.5);
    if (!(ticks >= 1 && ticks <= most_ticks
          && (BLOCK_TAKES_ANY_STEP
              || fabs(size - ticks * BLOCK_SAMPLE_TIME) <= step_tolerance * BLOCK_SAMPLE_TIME))) {
        return complain(m, "%s: communication step size: expected a multiple of %.16g, got %.16g", function,
                        BLOCK_SAMPLE_TIME, size);
    }
    if (point + size > m->stop + point_tolerance * BLOCK_SAMPLE_TIME) {
        return complain(m, "%s: communication step to %.16g; expected none beyond the stop time %.16g", function,
                        point + size, m->stop);
    }
    const int64_t last = m->now.tick + (int64_t)ticks;
    for (; m->now.tick < last; m->now.tick++) {
        block_step(&m->now.block); /* with the same inputs */
    }
    m->now.time = BLOCK_TAKES_ANY_STEP ? point + size
                                       : m->now.start + (double)m->now.tick * BLOCK_SAMPLE_TIME; /* never summed */
    return true;
}

bool shim_terminate(Instance *m, const char *function)
{
    if (!allowed(m, function, INITIALIZATION | STEPPING)) {
        return false;
    }
    m->now.mode = TERMINATED;
    return true;
}

bool shim_reset(Instance *m)
{
    if (!m) {
        return false;
    }
    start(m);
    return true;
}

double shim_time(const Instance *m)
{
    return m ? m->now.time : 0.0;
}

static const char *type_name(Type type)
{
    return type == INTEGER ? "an Integer" : type == BOOLEAN ? "a Boolean" : "a Real";
}

/* The variable behind a reference, or NULL with a message. REAL stands for both widths. */
static const Variable *find(const Instance *m, const char *function, uint32_t reference, Type type)
{
    if (reference >= VARIABLES) {
        complain(m, "%s: value reference %u is unknown; %s has 0 to %d", function, (unsigned)reference, BLOCK_NAME,
                 VARIABLES - 1);
        return NULL;
    }
    const Variable *v = &variables[reference];
    if ((v->type == REAL32 ? REAL : v->type) != type) {
        complain(m, "%s: value reference %u (%s) is %s, not %s", function, (unsigned)reference, v->name,
                 type_name(v->type), type_name(type));
        return NULL;
    }
    return v;
}

static const void *readable(Instance *m, const char *function, uint32_t reference, Type type)
{
    if (!allowed(m, function, ANY)) {
        return NULL;
    }
    const Variable *v = find(m, function, reference, type);
    if (!v) {
        return NULL;
    }
    refresh(m);
    return (const char *)&m->now + v->offset;
}

static void *writable(Instance *m, const char *function, uint32_t reference, Type type, double value)
{
    if (!allowed(m, function, INSTANTIATED | INITIALIZATION | STEPPING)) {
        return NULL;
    }
    const Variable *v = find(m, function, reference, type);
    if (!v) {
        return NULL;
    }
    if (v->role == OUTPUT || v->role == STATE || v->role == TIME) {
        complain(m, "%s: value reference %u (%s) is %s, which only %s itself sets", function, (unsigned)reference,
                 v->name, v->role == OUTPUT ? "an output" : v->role == STATE ? "a state" : "the time", BLOCK_NAME);
        return NULL;
    }
    if (v->role == FIXED && m->now.mode == STEPPING) {
        complain(m, "%s: value reference %u (%s) is a fixed parameter; expected it to be set before the end of "
                    "initialization", function, (unsigned)reference, v->name);
        return NULL;
    }
    if (v->role != INPUT && !(value >= v->min && value <= v->max)) { /* an input's range is the block's matter */
        complain(m, "%s: value reference %u (%s): got %.16g, expected %.16g to %.16g", function,
                 (unsigned)reference, v->name, value, v->min, v->max);
        return NULL;
    }
    m->now.stale = true;
    return (char *)&m->now + v->offset;
}

bool shim_get_real(Instance *m, const char *function, uint32_t reference, double *value)
{
    const void *from = readable(m, function, reference, REAL);
    if (!from) {
        return false;
    }
    *value = variables[reference].type == REAL32 ? (double)*(const float *)from : *(const double *)from;
    return true;
}

bool shim_get_integer(Instance *m, const char *function, uint32_t reference, int32_t *value)
{
    const void *from = readable(m, function, reference, INTEGER);
    if (!from) {
        return false;
    }
    *value = *(const int32_t *)from;
    return true;
}

bool shim_get_boolean(Instance *m, const char *function, uint32_t reference, bool *value)
{
    const void *from = readable(m, function, reference, BOOLEAN);
    if (!from) {
        return false;
    }
    *value = *(const bool *)from;
    return true;
}

bool shim_set_real(Instance *m, const char *function, uint32_t reference, double value)
{
    void *to = writable(m, function, reference, REAL, value);
    if (!to) {
        return false;
    }
    if (variables[reference].type == REAL32) {
        *(float *)to = (float)value;
    } else {
        *(double *)to = value;
    }
    return true;
}

bool shim_set_integer(Instance *m, const char *function, uint32_t reference, int32_t value)
{
    int32_t *to = writable(m, function, reference, INTEGER, (double)value);
    if (!to) {
        return false;
    }
    *to = value;
    return true;
}

bool shim_set_boolean(Instance *m, const char *function, uint32_t reference, bool value)
{
    bool *to = writable(m, function, reference, BOOLEAN, (double)value);
    if (!to) {
        return false;
    }
    *to = value;
    return true;
}

bool shim_get_state(const Instance *m, const char *function, void **state)
{
    if (!allowed(m, function, ANY)) {
        return false;
    }
    if (!*state) {
        *state = malloc(sizeof m->now);
    }
    if (!*state) {
        return complain(m, "%s: no memory for a state of %zu bytes", function, sizeof m->now);
    }
    memcpy(*state, &m->now, sizeof m->now);
    return true;
}

bool shim_set_state(Instance *m, const char *function, const void *state)
{
    if (!allowed(m, function, ANY)) {
        return false;
    }
    if (!state) {
        return complain(m, "%s: got no state, expected one that %s has given", function, BLOCK_NAME);
    }
    memcpy(&m->now, state, sizeof m->now);
    return true;
}

bool shim_free_state(void **state)
{
    free(*state);
    *state = NULL;
    return true;
}

/* A state in bytes: the token, so that no other block and no other version reads it, then the snapshot. */
size_t shim_serialized_size(void)
{
    return sizeof BLOCK_TOKEN + sizeof(Snapshot);
}

bool shim_serialize(const Instance *m, const char *function, const void *state, uint8_t bytes[], size_t size)
{
    if (!allowed(m, function, ANY)) {
        return false;
    }
    if (!state || size != shim_serialized_size()) {
        return complain(m, "%s: got %s and %zu bytes, expected a state and %zu bytes", function,
                        state ? "a state" : "no state", size, shim_serialized_size());
    }
    memcpy(bytes, BLOCK_TOKEN, sizeof BLOCK_TOKEN);
    memcpy(bytes + sizeof BLOCK_TOKEN, state, sizeof(Snapshot));
    return true;
}

bool shim_deserialize(const Instance *m, const char *function, const uint8_t bytes[], size_t size, void **state)
{
    if (!allowed(m, function, ANY)) {
        return false;
    }
    if (size != shim_serialized_size()) {
        return complain(m, "%s: got %zu bytes, a state of %s has %zu", function, size, BLOCK_NAME,
                        shim_serialized_size());
    }
    if (memcmp(bytes, BLOCK_TOKEN, sizeof BLOCK_TOKEN) != 0) {
        return complain(m, "%s: got the state of another unit, expected one of %s %s", function, BLOCK_NAME,
                        BLOCK_TOKEN);
    }
    if (!shim_get_state(m, function, state)) { /* for its memory */
        return false;
    }
    memcpy(*state, bytes + sizeof BLOCK_TOKEN, sizeof(Snapshot));
    return true;
}
