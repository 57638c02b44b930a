/* Ticks of a co-simulation: calls that were prepared in Python, one after the other.
   walk.py fills these structures, and its class Walk is the reference: both give the same bits. */
#include <fenv.h>
#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#include <pthread.h>
#include <unistd.h>
#endif

enum kind { COPY, CAST, CONVERT, REPLACE, ACCESS2, ACCESS3, STEP2, STEP3, STEPS, TURN };
enum type { FLOAT64, FLOAT32, INT8, INT16, INT32, INT64, UINT8, UINT16, UINT32, UINT64 };
enum pause { NONE, FAILED, NOT_FINITE, STOPPED };
enum { OK, WARNING, ASKED = INT_MIN, OUTSIDE }; /* asked: a step asked for what the loop lacks; a byte says for what */
#define NEARLY 0.999999 /* of a step: it was made */

typedef int (*access2)(void *, const void *, size_t, void *);
typedef int (*access3)(void *, const void *, size_t, void *, size_t);
typedef int (*step2)(void *, double, double, int);
typedef int (*step3)(void *, double, double, bool, bool *, bool *, bool *, double *);

typedef struct { /* of one value: to = factor * from + offset, whole numbers rounded and within low .. high */
    int from_type, to_type;
    const void *from;
    void *to;
    double factor, offset, low, high;
    int is_boolean; /* true unless 0 */
    const int64_t *table; /* whole numbers, each followed by the one that replaces it */
    size_t entries;
} conversion;

typedef struct {
    int kind;
    void (*function)(void);
    void *to;         /* the instance, or where to copy */
    const void *from; /* the value references, what to copy, or the conversions */
    size_t count;     /* of values, bytes, conversions or steps */
    void *values;
    double step; /* s */
    bool *event, *ended, *early; /* what an FMI 3 step answers */
    double *reached;
} call;

typedef struct { /* a call that is made on some ticks only */
    int64_t every, phase;  /* where tick modulo every is phase */
    const int64_t *stalls; /* but not from a tick to before another: pairs, apart and in their order */
    size_t count;
    call call;
} turn;

typedef struct {
    const call *calls;
    size_t count;
} list;

typedef struct { /* in memory of the caller, which another process may read */
    int64_t tick;
    int64_t call; /* its place among all calls of a tick; -1 between calls */
    int64_t rows; /* that are finished: row k is that of tick k */
    int64_t restored; /* how often a call had changed how sums are rounded */
    int64_t restorer; /* the last of these calls */
    double time; /* s, of the tick, or of the step within it that is being made */
} position;

typedef struct {
    list answer, advance; /* up to the row of a tick, and after it */
    double start;         /* s, what the FMUs count from */
    double step;          /* s, from tick to tick */
    const unsigned char *block; /* a row is a copy of it */
    size_t size;
    position *position;
    unsigned char *rows; /* a ring: row k lies at k modulo room */
    int64_t room;
    const double *doubles; /* real outputs, which must be finite */
    const float *singles;
    size_t double_count, single_count;
    const void *watched; /* an output that ends the run when it has one of the stop values */
    int watched_type;
    const double *stops;
    size_t stop_count;
    int is_guarded; /* restore `mode` behind each call */
    uint32_t mode;
    int status; /* what a call answered that failed */
} walk;

/* How sums are rounded, and whether the smallest become 0. */
EXPORT uint32_t floating_mode(void)
{
#if defined(__x86_64__) || defined(_M_X64)
    uint16_t old; /* of the old unit, which long doubles use */
    __asm__ volatile("fnstcw %0" : "=m"(old));
    return (uint32_t)old << 16 | (__builtin_ia32_stmxcsr() & 0xFFC0U); /* all but the flags of what happened */
#elif defined(__aarch64__)
    uint64_t control;
    __asm__ volatile("mrs %0, fpcr" : "=r"(control));
    return (uint32_t)control;
#else
    return (uint32_t)fegetround();
#endif
}

#if defined(_WIN32)
EXPORT void end_copies(void) { }
static void end_if_copy(void) { }
#else
static volatile bool is_copy;

static void note_copy(void)
{
    is_copy = true;
}

/* From now on a copy of this process that an FMU makes by fork ends when it comes back from the FMU. */
EXPORT void end_copies(void)
{
    pthread_atfork(NULL, NULL, note_copy);
}

static void end_if_copy(void)
{
    if (is_copy)
        _exit(0);
}
#endif

/* Behind each call of an FMU: bring back a mode; true if it was another. */
EXPORT int restore_mode(uint32_t mode)
{
    end_if_copy();
    if (floating_mode() == mode)
        return false;
#if defined(__x86_64__) || defined(_M_X64)
    const uint16_t old = (uint16_t)(mode >> 16);
    __asm__ volatile("fnclex\n\tfldcw %0" : : "m"(old));
    __builtin_ia32_ldmxcsr(mode & 0xFFFFU);
#elif defined(__aarch64__)
    __asm__ volatile("msr fpcr, %0" : : "r"((uint64_t)mode));
#else
    fesetround((int)mode);
#endif
    return true;
}

static double real(const void *from, int type)
{
    switch (type) {
    case FLOAT64: return *(const double *)from;
    case FLOAT32: return (double)*(const float *)from;
    case INT8: return *(const int8_t *)from;
    case INT16: return *(const int16_t *)from;
    case INT32: return *(const int32_t *)from;
    case INT64: return (double)*(const int64_t *)from;
    case UINT8: return *(const uint8_t *)from;
    case UINT16: return *(const uint16_t *)from;
    case UINT32: return *(const uint32_t *)from;
    default: return (double)*(const uint64_t *)from;
    }
}

typedef struct { /* a whole number of any type */
    uint64_t bits; /* modulo 2^64 */
    bool is_negative;
} number;

static number of_int64(int64_t x)
{
    return (number){(uint64_t)x, x < 0};
}

static number of_uint64(uint64_t x)
{
    return (number){x, false};
}

static number whole(const conversion *c)
{
    number x;
    switch (c->from_type) {
    case INT8: x = of_int64(*(const int8_t *)c->from); break;
    case INT16: x = of_int64(*(const int16_t *)c->from); break;
    case INT32: x = of_int64(*(const int32_t *)c->from); break;
    case INT64: x = of_int64(*(const int64_t *)c->from); break;
    case UINT8: x = of_uint64(*(const uint8_t *)c->from); break;
    case UINT16: x = of_uint64(*(const uint16_t *)c->from); break;
    case UINT32: x = of_uint64(*(const uint32_t *)c->from); break;
    default: x = of_uint64(*(const uint64_t *)c->from);
    }
    return c->is_boolean ? of_uint64(x.bits != 0) : x;
}

static bool is_within(number x, int64_t low, uint64_t high)
{
    return x.is_negative ? (int64_t)x.bits >= low : x.bits <= high;
}

/* False if the target's type does not hold it. */
static bool put_whole(const conversion *c, number x)
{
    switch (c->to_type) {
    case INT8: *(int8_t *)c->to = (int8_t)x.bits; return is_within(x, INT8_MIN, INT8_MAX);
    case INT16: *(int16_t *)c->to = (int16_t)x.bits; return is_within(x, INT16_MIN, INT16_MAX);
    case INT32: *(int32_t *)c->to = (int32_t)x.bits; return is_within(x, INT32_MIN, INT32_MAX);
    case INT64: *(int64_t *)c->to = (int64_t)x.bits; return is_within(x, INT64_MIN, INT64_MAX);
    case UINT8: *(uint8_t *)c->to = (uint8_t)x.bits; return is_within(x, 0, UINT8_MAX);
    case UINT16: *(uint16_t *)c->to = (uint16_t)x.bits; return is_within(x, 0, UINT16_MAX);
    case UINT32: *(uint32_t *)c->to = (uint32_t)x.bits; return is_within(x, 0, UINT32_MAX);
    default: *(uint64_t *)c->to = x.bits; return !x.is_negative;
    }
}

static double rounded(double x) /* to the nearest whole number, halves to the even one */
{
    const double grain = x < 0.0 ? -0x1p52 : 0x1p52; /* from there on all numbers are whole */
    return x > -0x1p52 && x < 0x1p52 ? (x + grain) - grain : x;
}

/* False if a finite number became infinite. */
static bool put_real(const conversion *c, double x)
{
    if (c->to_type == FLOAT64) {
        *(double *)c->to = x;
        return true;
    }
    if (c->to_type == FLOAT32) {
        const float y = *(float *)c->to = (float)x;
        return y - y == 0.0f || x - x != 0.0;
    }
    x = rounded(x);
    x = x < c->low ? c->low : x > c->high ? c->high : x;
    return put_whole(c, x < 0.0 ? of_int64((int64_t)x) : of_uint64((uint64_t)x));
}

static bool cast(const conversion *c)
{
    if (c->to_type == FLOAT64 || c->to_type == FLOAT32)
        return put_real(c, real(c->from, c->from_type));
    return put_whole(c, whole(c));
}

static bool convert(const conversion *c)
{
    const double x = c->is_boolean ? (double)whole(c).bits : real(c->from, c->from_type);
    return put_real(c, x * c->factor + c->offset);
}

static bool replace(const conversion *c)
{
    number x = whole(c);
    for (size_t i = 0; i < c->entries; i++) {
        const number replaced = of_int64(c->table[2 * i]);
        if (replaced.bits == x.bits && replaced.is_negative == x.is_negative) {
            x = of_int64(c->table[2 * i + 1]);
            break;
        }
    }
    return put_whole(c, x);
}

static bool has_failed(int status)
{
    return status != OK && status != WARNING;
}

static int make_step2(const call *c, double now)
{
    return ((step2)c->function)(c->to, now, c->step, 1);
}

static int make_step3(const call *c, double now)
{
    int status = ((step3)c->function)(c->to, now, c->step, true, c->event, c->ended, c->early, c->reached);
    if (has_failed(status))
        return status;
    if (*c->reached < now + c->step * NEARLY)
        *c->early = true;
    return *c->event || *c->ended || *c->early ? ASKED : status;
}

static int make_steps(walk *w, const call *c, double own)
{
    double *time = &w->position->time;
    const double begin = *time;
    for (size_t i = 0; i < c->count; i++) {
        const double passed = (double)i * c->step, now = w->start + (own + passed);
        *time = begin + passed;
        int status = c->reached ? make_step3(c, now) : make_step2(c, now);
        if (has_failed(status))
            return status;
    }
    *time = begin;
    return OK;
}

/* Is it the call's turn? A component that has stalled has a time of its own, which has no gaps. */
static bool is_due(const walk *w, const turn *t, double *own)
{
    const int64_t tick = w->position->tick;
    int64_t lag = 0;
    if (tick % t->every != t->phase)
        return false;
    for (size_t i = 0; i < t->count && t->stalls[2 * i] <= tick; i++) {
        if (tick < t->stalls[2 * i + 1])
            return false;
        lag += t->stalls[2 * i + 1] - t->stalls[2 * i];
    }
    *own = (double)(tick - lag) * w->step;
    return true;
}

static int make(walk *w, const call *c)
{
    double own = w->position->time;
    if (c->kind == TURN) {
        const turn *t = c->from;
        if (!is_due(w, t, &own))
            return OK;
        c = &t->call;
    }
    const conversion *first = c->from;
    switch (c->kind) {
    case ACCESS2: return ((access2)c->function)(c->to, c->from, c->count, c->values);
    case ACCESS3: return ((access3)c->function)(c->to, c->from, c->count, c->values, c->count);
    case STEP2: return make_step2(c, w->start + own);
    case STEP3: return make_step3(c, w->start + own);
    case STEPS: return make_steps(w, c, own);
    case CAST:
        for (size_t i = 0; i < c->count; i++)
            if (!cast(&first[i]))
                return OUTSIDE;
        return OK;
    case CONVERT:
        for (size_t i = 0; i < c->count; i++)
            if (!convert(&first[i]))
                return OUTSIDE;
        return OK;
    case REPLACE:
        for (size_t i = 0; i < c->count; i++)
            if (!replace(&first[i]))
                return OUTSIDE;
        return OK;
    default: memcpy(c->to, c->from, c->count); return OK;
    }
}

static bool carry_out(walk *w, const list *list, size_t before)
{
    for (size_t i = 0; i < list->count; i++) {
        w->position->call = (int64_t)(before + i);
        int status = make(w, &list->calls[i]);
        if (w->is_guarded && restore_mode(w->mode)) {
            w->position->restored++;
            w->position->restorer = (int64_t)(before + i);
        }
        if (has_failed(status)) {
            w->status = status;
            return false;
        }
    }
    w->position->call = -1;
    return true;
}

static bool is_stopped(const walk *w)
{
    for (size_t i = 0; i < w->stop_count; i++)
        if (real(w->watched, w->watched_type) == w->stops[i])
            return true;
    return false;
}

static bool are_finite(const walk *w)
{
    bool finite = true;
    for (size_t i = 0; i < w->double_count; i++)
        finite &= w->doubles[i] - w->doubles[i] == 0.0;
    for (size_t i = 0; i < w->single_count; i++)
        finite &= w->singles[i] - w->singles[i] == 0.0f;
    return finite;
}

/* Ticks from `tick` up to `end`, each with a row; after the last tick of the run nothing advances. */
EXPORT int run(walk *w, int64_t tick, int64_t end, int64_t last)
{
    for (; tick < end; tick++) {
        w->position->tick = tick;
        w->position->time = (double)tick * w->step;
        if (!carry_out(w, &w->answer, 0))
            return FAILED;
        memcpy(w->rows + (size_t)(tick % w->room) * w->size, w->block, w->size);
        __atomic_store_n(&w->position->rows, tick + 1, __ATOMIC_RELEASE); /* not before the row itself */
        if (!are_finite(w))
            return NOT_FINITE;
        if (is_stopped(w))
            return STOPPED;
        if (tick < last && !carry_out(w, &w->advance, w->answer.count))
            return FAILED;
    }
    return NONE;
}
