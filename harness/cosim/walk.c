/* Ticks of a co-simulation: C calls that were prepared in Python, one after the other.
   walk.py fills these structures, and its class Walk is the reference: both give the same rows. */
#include <stdbool.h>
#include <stddef.h>
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum kind { COPY, ACCESS2, ACCESS3, STEP2, STEP3 };
enum pause { NONE, FAILED, NOT_FINITE, CHANGED, ENDED };
enum { OK, WARNING };

typedef int (*access2)(void *, const void *, size_t, void *);
typedef int (*access3)(void *, const void *, size_t, void *, size_t);
typedef int (*step2)(void *, double, double, int);
typedef int (*step3)(void *, double, double, bool, bool *, bool *, bool *, double *);

typedef struct {
    int kind;
    void (*function)(void);
    void *to;         /* the instance, or where to copy */
    const void *from; /* the value references, or what to copy */
    size_t count;     /* of values, or of bytes */
    void *values;
    bool *event, *ended, *early; /* what an FMI 3 step answers */
    double *reached;
} call;

typedef struct {
    const call *answer, *advance; /* up to the row of a tick, and after it */
    size_t answers, advances;
    double *time; /* s, which the steps read */
    double step;  /* s */
    const unsigned char *block; /* a row is a copy of it */
    size_t size;
    unsigned char *rows;
    long *done; /* rows that are finished */
    const double *doubles; /* real outputs, which must be finite */
    const float *singles;
    size_t double_count, single_count;
    const unsigned char *watched; /* a change of it is reported */
    unsigned char *before;
    size_t watched_size;
    int is_known; /* is there a value before? */
    const unsigned char *ended; /* a byte for each component */
    size_t ended_count;
    /* what a pause is about */
    int is_answer; /* which list has the call that failed, */
    size_t failed; /* its place in there, */
    int status;    /* and what it answered */
} walk;

static int make(const call *c, const walk *w)
{
    switch (c->kind) {
    case ACCESS2: return ((access2)c->function)(c->to, c->from, c->count, c->values);
    case ACCESS3: return ((access3)c->function)(c->to, c->from, c->count, c->values, c->count);
    case STEP2: return ((step2)c->function)(c->to, *w->time, w->step, 1);
    case STEP3:
        return ((step3)c->function)(c->to, *w->time, w->step, true, c->event, c->ended, c->early, c->reached);
    default: memcpy(c->to, c->from, c->count); return OK;
    }
}

static bool carry_out(walk *w, const call *calls, size_t count)
{
    for (const call *c = calls; c < calls + count; c++) {
        int status = make(c, w);
        if (status != OK && status != WARNING) {
            w->is_answer = calls == w->answer;
            w->failed = (size_t)(c - calls);
            w->status = status;
            return false;
        }
    }
    return true;
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
EXPORT int run(walk *w, long tick, long end, long last)
{
    for (; tick < end; tick++) {
        *w->time = (double)tick * w->step;
        if (!carry_out(w, w->answer, w->answers))
            return FAILED;
        memcpy(w->rows + (size_t)*w->done * w->size, w->block, w->size);
        ++*w->done;
        if (!are_finite(w))
            return NOT_FINITE;
        if (w->watched_size && !(w->is_known && memcmp(w->watched, w->before, w->watched_size) == 0)) {
            w->is_known = 1;
            memcpy(w->before, w->watched, w->watched_size);
            return CHANGED;
        }
        for (size_t i = 0; i < w->ended_count; i++)
            if (w->ended[i])
                return ENDED;
        if (tick < last && !carry_out(w, w->advance, w->advances))
            return FAILED;
    }
    return NONE;
}
