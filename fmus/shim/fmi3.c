/* The functions of FMI 3.0 (co-simulation). */
#include "shim.h"

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wstrict-prototypes" /* the official header has two () */
#include "fmi3Functions.h"
#pragma GCC diagnostic pop

#include <math.h>

#define STATUS(done) ((done) ? fmi3OK : fmi3Error)

static void report(const Instance *m, const char *message)
{
    ((fmi3LogMessageCallback)shim_logger(m))(shim_environment(m), fmi3Error, "logStatusError", message);
}

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Status fmi3SetDebugLogging(fmi3Instance m, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)on, (void)n, (void)categories; /* errors are all that is ever logged */
    return STATUS(m);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources,
                                         fmi3Boolean visible, fmi3Boolean logging, fmi3Boolean events,
                                         fmi3Boolean early_return, const fmi3ValueReference required[],
                                         size_t n_required, fmi3InstanceEnvironment environment,
                                         fmi3LogMessageCallback log_message,
                                         fmi3IntermediateUpdateCallback intermediate_update)
{
    (void)resources, (void)visible, (void)logging, (void)early_return, (void)required, (void)n_required;
    (void)intermediate_update;
    Instance *m = shim_instantiate(__func__, name, token, report, (Callback)log_message, environment);
    if (m && events) {
        shim_lacks(m, "fmi3InstantiateCoSimulation with event mode");
        shim_free(m);
        return NULL;
    }
    return m;
}

/* Refuse another interface, which has no instance to ask. */
static fmi3Instance refuse(const char *interface, fmi3String name, fmi3String token,
                           fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message)
{
    Instance *m = shim_instantiate(interface, name, token, report, (Callback)log_message, environment);
    if (m) {
        shim_lacks(m, interface);
    }
    shim_free(m);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message)
{
    (void)resources, (void)visible, (void)logging;
    return refuse(__func__, name, token, environment, log_message);
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback log_message, fmi3ClockUpdateCallback clock,
                                               fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    (void)resources, (void)visible, (void)logging, (void)clock, (void)lock, (void)unlock;
    return refuse(__func__, name, token, environment, log_message);
}

void fmi3FreeInstance(fmi3Instance m)
{
    shim_free(m);
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance m, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    (void)tolerance_defined, (void)tolerance;
    return STATUS(shim_setup(m, __func__, start, stop_defined ? stop : HUGE_VAL)
                  && shim_enter_initialization(m, __func__));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance m)
{
    return STATUS(shim_exit_initialization(m, __func__));
}

fmi3Status fmi3Terminate(fmi3Instance m)
{
    return STATUS(shim_terminate(m, __func__));
}

fmi3Status fmi3Reset(fmi3Instance m)
{
    return STATUS(shim_reset(m));
}

fmi3Status fmi3DoStep(fmi3Instance m, fmi3Float64 point, fmi3Float64 size, fmi3Boolean no_return,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate, fmi3Boolean *early_return,
                      fmi3Float64 *last_time)
{
    (void)no_return;
    const bool done = shim_step(m, __func__, point, size);
    *event_needed = *terminate = *early_return = false;
    *last_time = shim_time(m);
    return STATUS(done);
}

/* Get and set the three types that blocks have. */
#define TYPE(Name, name)                                                                                          \
    fmi3Status fmi3Get##Name(fmi3Instance m, const fmi3ValueReference references[], size_t n,                     \
                             fmi3##Name values[], size_t n_values)                                                \
    {                                                                                                             \
        bool done = shim_same_count(m, __func__, n, n_values);                                                    \
        for (size_t i = 0; done && i < n; i++) {                                                                  \
            done = shim_get_##name(m, __func__, references[i], &values[i]);                                       \
        }                                                                                                         \
        return STATUS(done);                                                                                      \
    }                                                                                                             \
    fmi3Status fmi3Set##Name(fmi3Instance m, const fmi3ValueReference references[], size_t n,                     \
                             const fmi3##Name values[], size_t n_values)                                          \
    {                                                                                                             \
        bool done = shim_same_count(m, __func__, n, n_values);                                                    \
        for (size_t i = 0; done && i < n; i++) {                                                                  \
            done = shim_set_##name(m, __func__, references[i], values[i]);                                        \
        }                                                                                                         \
        return STATUS(done);                                                                                      \
    }

TYPE(Float64, real)
TYPE(Int32, integer)
TYPE(Boolean, boolean)

fmi3Status fmi3GetFMUState(fmi3Instance m, fmi3FMUState *state)
{
    return STATUS(shim_get_state(m, __func__, state));
}

fmi3Status fmi3SetFMUState(fmi3Instance m, fmi3FMUState state)
{
    return STATUS(shim_set_state(m, __func__, state));
}

fmi3Status fmi3FreeFMUState(fmi3Instance m, fmi3FMUState *state)
{
    (void)m;
    return STATUS(shim_free_state(state));
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance m, fmi3FMUState state, size_t *size)
{
    (void)m, (void)state;
    *size = shim_serialized_size();
    return fmi3OK;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance m, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return STATUS(shim_serialize(m, __func__, state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance m, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return STATUS(shim_deserialize(m, __func__, bytes, size, state));
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance m, size_t *n)
{
    *n = 0;
    return STATUS(m);
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance m, size_t *n)
{
    *n = 0;
    return STATUS(m);
}

/* What a sampled block of scalars lacks: other types, clocks, derivatives, events, configuration. */
#define LACKS(parameters, ...) parameters { return STATUS(shim_lacks(m, __func__, __VA_ARGS__)); }
#define LACKS_ALL(parameters) parameters { return STATUS(shim_lacks(m, __func__)); }
#define REFERENCES fmi3Instance m, const fmi3ValueReference r[], size_t n
#define LACKS_TYPE(Name)                                                                                          \
    fmi3Status fmi3Get##Name LACKS((REFERENCES, fmi3##Name v[], size_t nv), r, n, v, nv)                          \
    fmi3Status fmi3Set##Name LACKS((REFERENCES, const fmi3##Name v[], size_t nv), r, n, v, nv)

LACKS_TYPE(Float32)
LACKS_TYPE(Int8)
LACKS_TYPE(UInt8)
LACKS_TYPE(Int16)
LACKS_TYPE(UInt16)
LACKS_TYPE(UInt32)
LACKS_TYPE(Int64)
LACKS_TYPE(UInt64)
LACKS_TYPE(String)
fmi3Status fmi3GetBinary LACKS((REFERENCES, size_t s[], fmi3Binary v[], size_t nv), r, n, s, v, nv)
fmi3Status fmi3SetBinary LACKS((REFERENCES, const size_t s[], const fmi3Binary v[], size_t nv), r, n, s, v, nv)
fmi3Status fmi3GetClock LACKS((REFERENCES, fmi3Clock v[]), r, n, v)
fmi3Status fmi3SetClock LACKS((REFERENCES, const fmi3Clock v[]), r, n, v)
fmi3Status fmi3GetIntervalDecimal LACKS((REFERENCES, fmi3Float64 i[], fmi3IntervalQualifier q[]), r, n, i, q)
fmi3Status fmi3GetIntervalFraction LACKS((REFERENCES, fmi3UInt64 c[], fmi3UInt64 s[], fmi3IntervalQualifier q[]),
                                         r, n, c, s, q)
fmi3Status fmi3GetShiftDecimal LACKS((REFERENCES, fmi3Float64 s[]), r, n, s)
fmi3Status fmi3GetShiftFraction LACKS((REFERENCES, fmi3UInt64 c[], fmi3UInt64 s[]), r, n, c, s)
fmi3Status fmi3SetIntervalDecimal LACKS((REFERENCES, const fmi3Float64 i[]), r, n, i)
fmi3Status fmi3SetIntervalFraction LACKS((REFERENCES, const fmi3UInt64 c[], const fmi3UInt64 s[]), r, n, c, s)
fmi3Status fmi3SetShiftDecimal LACKS((REFERENCES, const fmi3Float64 s[]), r, n, s)
fmi3Status fmi3SetShiftFraction LACKS((REFERENCES, const fmi3UInt64 c[], const fmi3UInt64 s[]), r, n, c, s)
fmi3Status fmi3GetOutputDerivatives LACKS((REFERENCES, const fmi3Int32 o[], fmi3Float64 v[], size_t nv),
                                          r, n, o, v, nv)
fmi3Status fmi3GetDirectionalDerivative LACKS((REFERENCES, const fmi3ValueReference k[], size_t nk,
                                               const fmi3Float64 s[], size_t ns, fmi3Float64 d[], size_t nd),
                                              r, n, k, nk, s, ns, d, nd)
fmi3Status fmi3GetAdjointDerivative LACKS((REFERENCES, const fmi3ValueReference k[], size_t nk,
                                           const fmi3Float64 s[], size_t ns, fmi3Float64 d[], size_t nd),
                                          r, n, k, nk, s, ns, d, nd)
fmi3Status fmi3GetNumberOfVariableDependencies LACKS((fmi3Instance m, fmi3ValueReference r, size_t *n), r, n)
fmi3Status fmi3GetVariableDependencies LACKS((fmi3Instance m, fmi3ValueReference r, size_t e[],
                                              fmi3ValueReference k[], size_t ek[], fmi3DependencyKind d[],
                                              size_t n), r, e, k, ek, d, n)
fmi3Status fmi3EnterConfigurationMode LACKS_ALL((fmi3Instance m))
fmi3Status fmi3ExitConfigurationMode LACKS_ALL((fmi3Instance m))
fmi3Status fmi3EnterEventMode LACKS_ALL((fmi3Instance m))
fmi3Status fmi3EnterStepMode LACKS_ALL((fmi3Instance m))
fmi3Status fmi3EnterContinuousTimeMode LACKS_ALL((fmi3Instance m))
fmi3Status fmi3EvaluateDiscreteStates LACKS_ALL((fmi3Instance m))
fmi3Status fmi3UpdateDiscreteStates LACKS((fmi3Instance m, fmi3Boolean *u, fmi3Boolean *t, fmi3Boolean *nc,
                                           fmi3Boolean *vc, fmi3Boolean *nd, fmi3Float64 *nt), u, t, nc, vc, nd, nt)
fmi3Status fmi3CompletedIntegratorStep LACKS((fmi3Instance m, fmi3Boolean p, fmi3Boolean *e, fmi3Boolean *t),
                                             p, e, t)
fmi3Status fmi3SetTime LACKS((fmi3Instance m, fmi3Float64 t), t)
fmi3Status fmi3SetContinuousStates LACKS((fmi3Instance m, const fmi3Float64 x[], size_t n), x, n)
fmi3Status fmi3GetContinuousStateDerivatives LACKS((fmi3Instance m, fmi3Float64 x[], size_t n), x, n)
fmi3Status fmi3GetEventIndicators LACKS((fmi3Instance m, fmi3Float64 x[], size_t n), x, n)
fmi3Status fmi3GetContinuousStates LACKS((fmi3Instance m, fmi3Float64 x[], size_t n), x, n)
fmi3Status fmi3GetNominalsOfContinuousStates LACKS((fmi3Instance m, fmi3Float64 x[], size_t n), x, n)
fmi3Status fmi3ActivateModelPartition LACKS((fmi3Instance m, fmi3ValueReference c, fmi3Float64 t), c, t)
