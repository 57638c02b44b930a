/* The functions of FMI 2.0 (co-simulation). */
#include "shim.h"

#include "fmi2Functions.h"

#include <math.h>

#define STATUS(done) ((done) ? fmi2OK : fmi2Error)

static void report(const Instance *m, const char *message)
{
    char format[2 * MESSAGE_SIZE]; /* the logger's message is a format: no % may be one */
    size_t length = 0;
    for (; *message; message++) {
        if (*message == '%') {
            format[length++] = '%';
        }
        format[length++] = *message;
    }
    format[length] = '\0';
    ((fmi2CallbackLogger)shim_logger(m))(shim_environment(m), shim_name(m), fmi2Error, "logStatusError", format);
}

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Status fmi2SetDebugLogging(fmi2Component m, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    (void)on, (void)n, (void)categories; /* errors are all that is ever logged */
    return STATUS(m);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String token, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible, (void)logging;
    Instance *m = shim_instantiate(__func__, name, token, report, functions ? (Callback)functions->logger : NULL,
                                   functions ? functions->componentEnvironment : NULL);
    if (m && type != fmi2CoSimulation) {
        shim_lacks(m, "fmi2Instantiate for model exchange");
        shim_free(m);
        return NULL;
    }
    return m;
}

void fmi2FreeInstance(fmi2Component m)
{
    shim_free(m);
}

fmi2Status fmi2SetupExperiment(fmi2Component m, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)tolerance_defined, (void)tolerance;
    return STATUS(shim_setup(m, __func__, start, stop_defined ? stop : HUGE_VAL));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component m)
{
    return STATUS(shim_enter_initialization(m, __func__));
}

fmi2Status fmi2ExitInitializationMode(fmi2Component m)
{
    return STATUS(shim_exit_initialization(m, __func__));
}

fmi2Status fmi2Terminate(fmi2Component m)
{
    return STATUS(shim_terminate(m, __func__));
}

fmi2Status fmi2Reset(fmi2Component m)
{
    return STATUS(shim_reset(m));
}

fmi2Status fmi2DoStep(fmi2Component m, fmi2Real point, fmi2Real size, fmi2Boolean no_return)
{
    (void)no_return;
    return STATUS(shim_step(m, __func__, point, size));
}

fmi2Status fmi2GetReal(fmi2Component m, const fmi2ValueReference references[], size_t n, fmi2Real values[])
{
    for (size_t i = 0; i < n; i++) {
        if (!shim_get_real(m, __func__, references[i], &values[i])) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetInteger(fmi2Component m, const fmi2ValueReference references[], size_t n, fmi2Integer values[])
{
    for (size_t i = 0; i < n; i++) {
        if (!shim_get_integer(m, __func__, references[i], &values[i])) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component m, const fmi2ValueReference references[], size_t n, fmi2Boolean values[])
{
    for (size_t i = 0; i < n; i++) {
        bool value;
        if (!shim_get_boolean(m, __func__, references[i], &value)) {
            return fmi2Error;
        }
        values[i] = value ? fmi2True : fmi2False;
    }
    return fmi2OK;
}

fmi2Status fmi2SetReal(fmi2Component m, const fmi2ValueReference references[], size_t n, const fmi2Real values[])
{
    for (size_t i = 0; i < n; i++) {
        if (!shim_set_real(m, __func__, references[i], values[i])) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetInteger(fmi2Component m, const fmi2ValueReference references[], size_t n,
                          const fmi2Integer values[])
{
    for (size_t i = 0; i < n; i++) {
        if (!shim_set_integer(m, __func__, references[i], values[i])) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2SetBoolean(fmi2Component m, const fmi2ValueReference references[], size_t n,
                          const fmi2Boolean values[])
{
    for (size_t i = 0; i < n; i++) {
        if (!shim_set_boolean(m, __func__, references[i], values[i] != fmi2False)) {
            return fmi2Error;
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetFMUstate(fmi2Component m, fmi2FMUstate *state)
{
    return STATUS(shim_get_state(m, __func__, state));
}

fmi2Status fmi2SetFMUstate(fmi2Component m, fmi2FMUstate state)
{
    return STATUS(shim_set_state(m, __func__, state));
}

fmi2Status fmi2FreeFMUstate(fmi2Component m, fmi2FMUstate *state)
{
    (void)m;
    return STATUS(shim_free_state(state));
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component m, fmi2FMUstate state, size_t *size)
{
    (void)m, (void)state;
    *size = shim_serialized_size();
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component m, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    return STATUS(shim_serialize(m, __func__, state, (uint8_t *)bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component m, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    return STATUS(shim_deserialize(m, __func__, (const uint8_t *)bytes, size, state));
}

/* A step is done when fmi2DoStep returns, so there is nothing pending to ask about. */
fmi2Status fmi2GetRealStatus(fmi2Component m, const fmi2StatusKind kind, fmi2Real *value)
{
    if (!m || kind != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = shim_time(m);
    return fmi2OK;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component m, const fmi2StatusKind kind, fmi2Boolean *value)
{
    if (!m || kind != fmi2Terminated) {
        return fmi2Discard;
    }
    *value = fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStatus(fmi2Component m, const fmi2StatusKind kind, fmi2Status *value)
{
    shim_lacks(m, __func__, kind, value);
    return fmi2Discard;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component m, const fmi2StatusKind kind, fmi2Integer *value)
{
    shim_lacks(m, __func__, kind, value);
    return fmi2Discard;
}

fmi2Status fmi2GetStringStatus(fmi2Component m, const fmi2StatusKind kind, fmi2String *value)
{
    shim_lacks(m, __func__, kind, value);
    return fmi2Discard;
}

/* What a sampled block without strings, derivatives and events lacks. */
#define LACKS(parameters, ...) parameters { return STATUS(shim_lacks(m, __func__, __VA_ARGS__)); }
#define LACKS_ALL(parameters) parameters { return STATUS(shim_lacks(m, __func__)); }

fmi2Status fmi2GetString LACKS((fmi2Component m, const fmi2ValueReference r[], size_t n, fmi2String v[]), r, n, v)
fmi2Status fmi2SetString LACKS((fmi2Component m, const fmi2ValueReference r[], size_t n, const fmi2String v[]),
                               r, n, v)
fmi2Status fmi2GetDirectionalDerivative LACKS((fmi2Component m, const fmi2ValueReference u[], size_t nu,
                                               const fmi2ValueReference k[], size_t nk, const fmi2Real dk[],
                                               fmi2Real du[]), u, nu, k, nk, dk, du)
fmi2Status fmi2SetRealInputDerivatives LACKS((fmi2Component m, const fmi2ValueReference r[], size_t n,
                                              const fmi2Integer o[], const fmi2Real v[]), r, n, o, v)
fmi2Status fmi2GetRealOutputDerivatives LACKS((fmi2Component m, const fmi2ValueReference r[], size_t n,
                                               const fmi2Integer o[], fmi2Real v[]), r, n, o, v)
fmi2Status fmi2CancelStep LACKS_ALL((fmi2Component m))
fmi2Status fmi2EnterEventMode LACKS_ALL((fmi2Component m))
fmi2Status fmi2NewDiscreteStates LACKS((fmi2Component m, fmi2EventInfo *e), e)
fmi2Status fmi2EnterContinuousTimeMode LACKS_ALL((fmi2Component m))
fmi2Status fmi2CompletedIntegratorStep LACKS((fmi2Component m, fmi2Boolean p, fmi2Boolean *e, fmi2Boolean *t),
                                             p, e, t)
fmi2Status fmi2SetTime LACKS((fmi2Component m, fmi2Real t), t)
fmi2Status fmi2SetContinuousStates LACKS((fmi2Component m, const fmi2Real x[], size_t n), x, n)
fmi2Status fmi2GetDerivatives LACKS((fmi2Component m, fmi2Real x[], size_t n), x, n)
fmi2Status fmi2GetEventIndicators LACKS((fmi2Component m, fmi2Real x[], size_t n), x, n)
fmi2Status fmi2GetContinuousStates LACKS((fmi2Component m, fmi2Real x[], size_t n), x, n)
fmi2Status fmi2GetNominalsOfContinuousStates LACKS((fmi2Component m, fmi2Real x[], size_t n), x, n)
