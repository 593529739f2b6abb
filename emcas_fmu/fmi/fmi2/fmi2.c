/* FMI 2.0 for co-simulation around core.h.
 *
 * A variable's value reference is its index in the table of inputs, outputs and parameters. There is no global state
 * that changes and no allocation while stepping.
 */
#include <stdbool.h>
#include <stdlib.h>

#include "fmi2Functions.h"

#define GUID_NAME "GUID"

typedef fmi2CallbackFunctions host_services;

static void log_message(const host_services *host, const char *name, int status, const char *category, char *text)
{
    if (!host->logger) return;
    /* The text is the format: hosts in other languages cannot read variable arguments. */
    for (char *at = text; *at; ++at)
        if (*at == '%') *at = '/';
    host->logger(host->componentEnvironment, name, (fmi2Status)status, category, text);
}

static void *allocate(const host_services *host, size_t size)
{
    return host->allocateMemory ? host->allocateMemory(1, size) : calloc(1, size);
}

static void release(const host_services *host, void *block)
{
    if (host->freeMemory)
        host->freeMemory(block);
    else
        free(block);
}

static bool handles_events(const host_services *host)
{
    (void)host;
    return false;
}

#include "instance.h"
#include "states.h"
#include "step.h"

_Static_assert((int)STATUS_OK == (int)fmi2OK && (int)STATUS_WARNING == (int)fmi2Warning
               && (int)STATUS_DISCARD == (int)fmi2Discard && (int)STATUS_ERROR == (int)fmi2Error, "fmi2Status");

/* -- variables ---------------------------------------------------------------- */

static bool is_a(const instance *m, size_t vr, int kind)
{
    if (vr < FMU_VARIABLES && VARIABLE[vr].kind == kind) return true;
    report(m, fmi2Error, "no %s variable has value reference %u", KIND[kind], (unsigned)vr);
    return false;
}

#define DEFINE_SET(Kind, expected, converted)                                                                   \
    fmi2Status fmi2Set##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Kind value[]) \
    {                                                                                                           \
        instance *m = c;                                                                                        \
        bool good = true;                                                                                       \
        if (!allowed(m, ANY_PHASE & ~TERMINATED, "fmi2Set" #Kind)) return fmi2Error;                            \
        if (array_missing(m, n, vr, value, "fmi2Set" #Kind)) return fmi2Error;                                  \
        for (size_t i = 0; i < n; ++i) good &= is_a(m, vr[i], expected) && settable(m, vr[i], converted(value[i]));               \
        for (size_t i = 0; good && i < n; ++i) set_one(m, vr[i], converted(value[i]));                          \
        return good ? fmi2OK : fmi2Error;                                                                       \
    }

#define AS_NUMBER(x) ((double)(x))
#define AS_FLAG(x) ((x) ? 1.0 : 0.0)

#define DEFINE_GET(Kind, expected)                                                                              \
    fmi2Status fmi2Get##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Kind value[])       \
    {                                                                                                           \
        instance *m = c;                                                                                        \
        fmi2Status status = fmi2OK;                                                                             \
        if (!allowed(m, ANY_PHASE, "fmi2Get" #Kind)) return fmi2Error;                                          \
        if (array_missing(m, n, vr, value, "fmi2Get" #Kind)) return fmi2Error;                                  \
        if (!m->s.fresh) refresh(m);                                                                            \
        for (size_t i = 0; i < n; ++i) {                                                                        \
            if (vr[i] < FMU_VARIABLES && VARIABLE[vr[i]].kind == expected)                                    \
                value[i] = (fmi2##Kind)m->s.values[vr[i]];                                                      \
            else                                                                                                \
                status = report(m, fmi2Error, "no " #Kind " variable has value reference %u", (unsigned)vr[i]); \
        }                                                                                                       \
        return status;                                                                                          \
    }

DEFINE_SET(Real, REAL, AS_NUMBER)
DEFINE_SET(Integer, INTEGER, AS_NUMBER)
DEFINE_SET(Boolean, BOOLEAN, AS_FLAG)
DEFINE_GET(Real, REAL)
/* These values are always in the range of their type: they are checked when they are set. */
DEFINE_GET(Integer, INTEGER)
DEFINE_GET(Boolean, BOOLEAN)

static fmi2Status no_strings(instance *m, int phases, size_t n, const char *function)
{
    if (!allowed(m, phases, function)) return fmi2Error;
    return n ? report(m, fmi2Error, "%s: there is no String variable", function) : fmi2OK;
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[])
{
    (void)vr, (void)value;
    return no_strings(c, ANY_PHASE, n, "fmi2GetString");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[])
{
    (void)vr, (void)value;
    return no_strings(c, ANY_PHASE & ~TERMINATED, n, "fmi2SetString");
}

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    instance *m = c;
    if (!allowed(m, ANY_PHASE & ~TERMINATED, "fmi2SetRealInputDerivatives")) return fmi2Error;
    if (array_missing(m, n, vr, value, "fmi2SetRealInputDerivatives")) return fmi2Error;
    if (array_missing(m, n, order, order, "fmi2SetRealInputDerivatives")) return fmi2Error;
    for (size_t i = 0; i < n; ++i) {
        if (vr[i] >= OUTPUT_BEGIN || VARIABLE[vr[i]].kind != REAL)
            return report(m, fmi2Error, "no Real input has value reference %u", (unsigned)vr[i]);
        if (order[i] != 1)
            return report(m, fmi2Error, "derivative of order %d of %s: only order 1 is used", (int)order[i],
                          VARIABLE[vr[i]].name);
        if (!core_finite(value[i]))
            return report(m, fmi2Error, "derivative of %s = %.9g is not a finite number", VARIABLE[vr[i]].name,
                          value[i]);
    }
    for (size_t i = 0; i < n; ++i) m->s.rates[vr[i]] = value[i];
    m->s.rated = n || m->s.rated;
    return fmi2OK;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                        const fmi2Integer order[], fmi2Real value[])
{
    instance *m = c;
    (void)vr, (void)order, (void)value;
    if (!allowed(m, ANY_PHASE, "fmi2GetRealOutputDerivatives")) return fmi2Error;
    return n ? report(m, fmi2Error, "fmi2GetRealOutputDerivatives: maxOutputDerivativeOrder is 0") : fmi2OK;
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown,
                                        const fmi2ValueReference known[], size_t n_known, const fmi2Real seed[],
                                        fmi2Real value[])
{
    instance *m = c;
    (void)unknown, (void)n_unknown, (void)known, (void)n_known, (void)seed, (void)value;
    if (!allowed(m, ANY_PHASE, "fmi2GetDirectionalDerivative")) return fmi2Error;
    return report(m, fmi2Error, "fmi2GetDirectionalDerivative: providesDirectionalDerivative is false");
}

/* -- stepping ----------------------------------------------------------------- */

/* Step with inputs that change linearly; motion loads are interpolated between those at the ends. Afterwards the inputs
 * are at the ends of their ramps, and are held there until they or their derivatives are set again. */
static core_result ramped_step(instance *m, double begin, double end)
{
    double final[FMU_INPUTS], motion_loads[FINS][CORE_MOTION_LOADS];
    const double size = end - begin;
    core_inputs in[FINS];
    core_ramp ramp[FINS];
    for (size_t i = 0; i < FMU_INPUTS; ++i) final[i] = m->s.values[i] + m->s.rates[i] * size;
    if (!(size > 0.0) || !core_all_finite(final, FMU_INPUTS)) return CORE_NOT_FINITE;
    update_motion_loads(m, final, motion_loads);
    acting_now(m, in);
    for (size_t fin = 0; fin < FINS; ++fin) {
        double slopes[CORE_MOTION_LOADS];
        for (size_t i = 0; i < CORE_MOTION_LOADS; ++i) slopes[i] = (motion_loads[fin][i] - m->motion_loads[fin][i]) / size;
        core_inputs rates;
        acting(m, fin, m->s.rates, slopes, &rates); /* linear in all but these */
        ramp[fin] = (core_ramp){.begin = begin, .command = rates.command, .supply = rates.supply};
        memcpy(ramp[fin].loads, rates.loads, sizeof ramp[fin].loads);
        memcpy(ramp[fin].further, rates.further, sizeof ramp[fin].further);
    }
    const core_result result = run(m, end, in, ramp);
    if (result == CORE_DONE) {
        memcpy(m->s.values, final, sizeof final);
        memcpy(m->motion_loads, motion_loads, sizeof motion_loads);
        memset(m->s.rates, 0, sizeof m->s.rates);
        m->s.rated = 0;
    }
    return result;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_set_state)
{
    instance *m = c;
    double end = 0.0;
    (void)no_set_state;
    if (!allowed(m, RUNNING, "fmi2DoStep")) return fmi2Error;
    if (step_end(m, time, size, &end) != STATUS_OK) return fmi2Error;
    const double begin = time - m->s.start;
    const core_result result = m->s.rated && end > begin ? ramped_step(m, begin, end) : held_step(m, end);
    m->s.terminated = result != CORE_DONE; /* otherwise fmpy repeats the same step for ever */
    return step_done(m, result, time, size, end);
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    const instance *m = c;
    return m ? report(m, fmi2Error, "fmi2CancelStep: steps are not asynchronous") : fmi2Error;
}

/* Check a request for a kind of status, of which one is `available` or none (NO_STATUS). */
static fmi2Status status_of(const instance *m, int kind, int available, const char *function, const void *value)
{
    if (!allowed(m, RUNNING | TERMINATED, function)) return fmi2Error;
    if (!value) return report(m, fmi2Error, "%s: the pointer for the result is NULL", function);
    if (kind != available) return report(m, fmi2Discard, "%s: status kind %d is not available", function, kind);
    return fmi2OK;
}

enum { NO_STATUS = -1 };

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    return status_of(c, (int)kind, NO_STATUS, "fmi2GetStatus", value);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    const instance *m = c;
    const fmi2Status status = status_of(m, (int)kind, fmi2LastSuccessfulTime, "fmi2GetRealStatus", value);
    if (status == fmi2OK) *value = m->s.start + m->s.now;
    return status;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    return status_of(c, (int)kind, NO_STATUS, "fmi2GetIntegerStatus", value);
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    const instance *m = c;
    const fmi2Status status = status_of(m, (int)kind, fmi2Terminated, "fmi2GetBooleanStatus", value);
    if (status == fmi2OK) *value = m->s.terminated ? fmi2True : fmi2False;
    return status;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    return status_of(c, (int)kind, NO_STATUS, "fmi2GetStringStatus", value);
}

/* -- life cycle --------------------------------------------------------------- */

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

const char *fmi2GetVersion(void)
{
    return fmi2Version;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible;
    if (!functions) return NULL;
    const instance none = {
        .host = *functions, .name = name ? name : MODEL_NAME, .logged = logging ? EVERY_CATEGORY : 0};
    if (type != fmi2CoSimulation)
        report(&none, fmi2Error, "only fmi2CoSimulation is supported, not type %d", (int)type);
    else if (!functions->allocateMemory != !functions->freeMemory)
        report(&none, fmi2Error, "allocateMemory and freeMemory must be set together");
    else
        return new_instance(functions, name, guid, logging);
    return NULL;
}

void fmi2FreeInstance(fmi2Component c)
{
    free_instance(c);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    return c ? choose_categories(c, on, n, categories, "fmi2SetDebugLogging") : fmi2Error;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    return allowed(c, INSTANTIATED, "fmi2SetupExperiment") ? begin_initialization(c, start) : fmi2Error;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    instance *m = c;
    if (!allowed(m, INSTANTIATED, "fmi2EnterInitializationMode")) return fmi2Error;
    m->s.phase = INITIALIZING;
    return fmi2OK;
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c)
{
    return allowed(c, INITIALIZING, "fmi2ExitInitializationMode") ? finish_initialization(c, RUNNING) : fmi2Error;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    return allowed(c, RUNNING, "fmi2Terminate") ? terminate(c) : fmi2Error;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    if (!c) return fmi2Error;
    reset_instance(c);
    return fmi2OK;
}

/* -- states ------------------------------------------------------------------- */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    return copy_state(c, state, "fmi2GetFMUstate");
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    return restore_state(c, state, "fmi2SetFMUstate");
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    return free_state(c, state);
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    return serialized_size(c, state, size, "fmi2SerializedFMUstateSize");
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    return serialize(c, state, bytes, size, "fmi2SerializeFMUstate");
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    return deserialize(c, bytes, size, state, "fmi2DeSerializeFMUstate");
}
