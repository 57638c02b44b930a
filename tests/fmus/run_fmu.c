/* Runs the binary of an FMU over given inputs, on the platform that this is compiled for: in an emulator of it.
 *
 *     run_fmu LIBRARY VERSION TOKEN STEP < job
 *
 * The job has the inputs and the outputs, each as their number, and kind (r, i, b) and value reference of each; then
 * the ticks, and the inputs of each tick. A line of outputs comes out after initialization and after each step. Values
 * are the bits of a double, in hexadecimal. Whatever goes wrong ends it with a word on stderr. */
#include <inttypes.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fmi2FunctionTypes.h"
#include "fmi3FunctionTypes.h"

#ifdef _WIN32
#include <windows.h>
static HMODULE library;
static void open_library(const char *path) { library = LoadLibraryA(path); }
#define SYMBOL(name) ((void *)(uintptr_t)GetProcAddress(library, name))
#else
#include <dlfcn.h>
static void *library;
static void open_library(const char *path) { library = dlopen(path, RTLD_NOW | RTLD_LOCAL); }
#define SYMBOL(name) dlsym(library, name)
#endif

enum { MOST = 64 };

typedef struct {
    int count;
    char kind[MOST];
    unsigned reference[MOST];
} Variables;

static void fail(const char *what)
{
    fprintf(stderr, "run_fmu: %s\n", what);
    exit(1);
}

static void check(int status, const char *call)
{
    if (status != 0) {
        fail(call);
    }
}

static void *find(const char *name)
{
    void *symbol = SYMBOL(name);
    if (!symbol) {
        fail(name);
    }
    return symbol;
}

static void read_variables(Variables *v)
{
    if (scanf("%d", &v->count) != 1 || v->count > MOST) {
        fail("the job has no number of variables, or too many");
    }
    for (int i = 0; i < v->count; i++) {
        if (scanf(" %c %u", &v->kind[i], &v->reference[i]) != 2) {
            fail("the job lacks a variable");
        }
    }
}

static double read_value(void)
{
    uint64_t bits;
    double value;
    if (scanf("%" SCNx64, &bits) != 1) {
        fail("the job lacks a value");
    }
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void write_value(double value, char end)
{
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    printf("%016" PRIx64 "%c", bits, end);
}

/* Call a function of the FMU, which returns a status. */
#define CALL(name, ...) check(((name##TYPE *)find(#name))(__VA_ARGS__), #name)

static void *instance;

static void log2(fmi2ComponentEnvironment e, fmi2String name, fmi2Status s, fmi2String c, fmi2String text, ...)
{
    (void)e, (void)name, (void)s, (void)c;
    fprintf(stderr, "%s\n", text);
}

static void start2(const char *token)
{
    static const fmi2CallbackFunctions callbacks = { log2, calloc, free, NULL, NULL };
    instance = ((fmi2InstantiateTYPE *)find("fmi2Instantiate"))("it", fmi2CoSimulation, token, "", &callbacks, 0, 1);
    if (!instance) {
        fail("fmi2Instantiate");
    }
    CALL(fmi2SetupExperiment, instance, 0, 0, 0, 0, 0);
    CALL(fmi2EnterInitializationMode, instance);
    CALL(fmi2ExitInitializationMode, instance);
}

static void set2(char kind, unsigned reference, double value)
{
    const fmi2Integer whole = (fmi2Integer)value;
    if (kind == 'r') {
        CALL(fmi2SetReal, instance, &reference, 1, &value);
    } else if (kind == 'i') {
        CALL(fmi2SetInteger, instance, &reference, 1, &whole);
    } else {
        CALL(fmi2SetBoolean, instance, &reference, 1, &whole);
    }
}

static double get2(char kind, unsigned reference)
{
    fmi2Real value = 0;
    fmi2Integer whole = 0;
    if (kind == 'r') {
        CALL(fmi2GetReal, instance, &reference, 1, &value);
    } else if (kind == 'i') {
        CALL(fmi2GetInteger, instance, &reference, 1, &whole);
    } else {
        CALL(fmi2GetBoolean, instance, &reference, 1, &whole);
    }
    return kind == 'r' ? value : whole;
}

static void step2(double time, double size)
{
    CALL(fmi2DoStep, instance, time, size, 1);
}

static void end2(void)
{
    CALL(fmi2Terminate, instance);
    ((fmi2FreeInstanceTYPE *)find("fmi2FreeInstance"))(instance);
}

static void log3(fmi3InstanceEnvironment e, fmi3Status s, fmi3String c, fmi3String text)
{
    (void)e, (void)s, (void)c;
    fprintf(stderr, "%s\n", text);
}

static void start3(const char *token)
{
    instance = ((fmi3InstantiateCoSimulationTYPE *)find("fmi3InstantiateCoSimulation"))(
        "it", token, "", 0, 1, 0, 0, NULL, 0, NULL, log3, NULL);
    if (!instance) {
        fail("fmi3InstantiateCoSimulation");
    }
    CALL(fmi3EnterInitializationMode, instance, 0, 0, 0, 0, 0);
    CALL(fmi3ExitInitializationMode, instance);
}

static void set3(char kind, unsigned reference, double value)
{
    const fmi3Int32 whole = (fmi3Int32)value;
    const fmi3Boolean truth = value != 0;
    if (kind == 'r') {
        CALL(fmi3SetFloat64, instance, &reference, 1, &value, 1);
    } else if (kind == 'i') {
        CALL(fmi3SetInt32, instance, &reference, 1, &whole, 1);
    } else {
        CALL(fmi3SetBoolean, instance, &reference, 1, &truth, 1);
    }
}

static double get3(char kind, unsigned reference)
{
    fmi3Float64 value = 0;
    fmi3Int32 whole = 0;
    fmi3Boolean truth = 0;
    if (kind == 'r') {
        CALL(fmi3GetFloat64, instance, &reference, 1, &value, 1);
    } else if (kind == 'i') {
        CALL(fmi3GetInt32, instance, &reference, 1, &whole, 1);
    } else {
        CALL(fmi3GetBoolean, instance, &reference, 1, &truth, 1);
    }
    return kind == 'r' ? value : kind == 'i' ? whole : truth;
}

static void step3(double time, double size)
{
    fmi3Boolean event, terminate, early;
    fmi3Float64 reached;
    CALL(fmi3DoStep, instance, time, size, 1, &event, &terminate, &early, &reached);
}

static void end3(void)
{
    CALL(fmi3Terminate, instance);
    ((fmi3FreeInstanceTYPE *)find("fmi3FreeInstance"))(instance);
}

static const struct {
    void (*start)(const char *token);
    void (*set)(char kind, unsigned reference, double value);
    double (*get)(char kind, unsigned reference);
    void (*step)(double time, double size);
    void (*end)(void);
} versions[] = { { start2, set2, get2, step2, end2 }, { start3, set3, get3, step3, end3 } };

int main(int argc, char **argv)
{
    static Variables inputs, outputs;
    int ticks;
    if (argc != 5) {
        fail("expected LIBRARY VERSION TOKEN STEP");
    }
    open_library(argv[1]);
    if (!library) {
        fail("the library cannot be loaded");
    }
    const int index = atoi(argv[2]) - 2;
    const double step = strtod(argv[4], NULL);
    read_variables(&inputs);
    read_variables(&outputs);
    if (scanf("%d", &ticks) != 1) {
        fail("the job lacks its ticks");
    }
    versions[index].start(argv[3]);
    for (int tick = 0;; tick++) {
        for (int i = 0; i < outputs.count; i++) {
            write_value(versions[index].get(outputs.kind[i], outputs.reference[i]), i + 1 < outputs.count ? ' ' : '\n');
        }
        if (tick == ticks) {
            break;
        }
        for (int i = 0; i < inputs.count; i++) {
            versions[index].set(inputs.kind[i], inputs.reference[i], read_value());
        }
        versions[index].step(tick * step, step);
    }
    versions[index].end();
    return 0;
}
