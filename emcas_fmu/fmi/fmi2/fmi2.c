/* FMI 2.0 for co-simulation around core.h.
 *
 * A variable's value reference is its index in the table of inputs, outputs and parameters. There are no global
 * variables that change, and no step allocates memory.
 */
#include <stdbool.h>
#include <stdlib.h>

#include "interface.h"
#include "fmi2Functions.h"

#ifdef __GNUC__ /* functions of the standard have parameters that the FMU does not need */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#endif

/* The name of a function or type. The common files use the names of FMI 3.0; FMI 2.0 spells some differently. */
#define FMI(name) FMI_PASTE(fmi2, name)
#define FMI_PASTE(version, name) version##name
#define GetFMUState GetFMUstate
#define SetFMUState SetFMUstate
#define FreeFMUState FreeFMUstate
#define SerializedFMUStateSize SerializedFMUstateSize
#define SerializeFMUState SerializeFMUstate
#define DeserializeFMUState DeSerializeFMUstate
#define GUID_NAME "GUID"

typedef fmi2CallbackFunctions host_services;

static void log_message(const host_services *host, const char *name, int status, const char *category, char *text)
{
    if (!host->logger) return;
    /* The text is passed as the format, since hosts in other languages cannot read arguments; it must have no %. */
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

#include "instance.h"
#include "life_cycle.h"
#include "states.h"
#include "step.h"

static bool is_a(const instance *m, size_t vr, int kind)
{
    if (vr < FMU_VARIABLES && VARIABLE[vr].kind == kind && !VARIABLE[vr].hidden) return true;
    report(m, fmi2Error, NO_VARIABLE, KIND[kind], (unsigned)vr);
    return false;
}

/* The conversions lose nothing: a call gets and sets only variables of its type. */
#define DEFINE_ACCESS(Kind, kind, as_number)                                                                    \
    fmi2Status fmi2Get##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Kind value[])       \
    {                                                                                                           \
        instance *m = c;                                                                                        \
        bool good = true;                                                                                       \
        if (!allowed_with(m, ANY_PHASE, n, vr, value, __func__)) return fmi2Error;                              \
        for (size_t i = 0; i < n; ++i) good &= is_a(m, vr[i], kind);                                            \
        if (good && !m->s.fresh) refresh(m);                                                                    \
        for (size_t i = 0; good && i < n; ++i) value[i] = (fmi2##Kind)m->s.values[vr[i]];                       \
        return good ? fmi2OK : fmi2Error;                                                                       \
    }                                                                                                           \
    fmi2Status fmi2Set##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Kind value[]) \
    {                                                                                                           \
        instance *m = c;                                                                                        \
        bool good = true;                                                                                       \
        if (!allowed_with(m, BEFORE_END, n, vr, value, __func__)) return fmi2Error;                             \
        for (size_t i = 0; i < n; ++i)                                                                          \
            good &= is_a(m, vr[i], kind) && settable(m, vr[i], as_number(value[i]));                            \
        for (size_t i = 0; good && i < n; ++i) set_one(m, vr[i], as_number(value[i]));                          \
        return good ? fmi2OK : fmi2Error;                                                                       \
    }

DEFINE_ACCESS(Real, REAL, (double))
DEFINE_ACCESS(Integer, INTEGER, (double))
DEFINE_ACCESS(Boolean, BOOLEAN, !!)

UNSUPPORTED(GetString, ANY_PHASE, n, "there is no String variable",
            (fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2String value[]))
UNSUPPORTED(SetString, BEFORE_END, n, "there is no String variable",
            (fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2String value[]))
UNSUPPORTED(GetRealOutputDerivatives, ANY_PHASE, n, "maxOutputDerivativeOrder is 0",
            (fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Integer order[], fmi2Real value[]))
UNSUPPORTED(GetDirectionalDerivative, ANY_PHASE, 1, "providesDirectionalDerivative is false",
            (fmi2Component c, const fmi2ValueReference unknown[], size_t n_unknown, const fmi2ValueReference known[],
             size_t n_known, const fmi2Real seed[], fmi2Real value[]))

fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference vr[], size_t n,
                                       const fmi2Integer order[], const fmi2Real value[])
{
    instance *m = c;
    if (!allowed_with(m, BEFORE_END, n, vr, value, __func__)) return fmi2Error;
    if (!allowed_with(m, BEFORE_END, n, order, order, __func__)) return fmi2Error;
    for (size_t i = 0; i < n; ++i) {
        if (vr[i] >= OUTPUT_BEGIN || VARIABLE[vr[i]].kind != REAL || VARIABLE[vr[i]].tunable || VARIABLE[vr[i]].hidden)
            return report(m, fmi2Error, NO_VARIABLE, "Real input", (unsigned)vr[i]);
        if (order[i] != 1)
            return report(m, fmi2Error, "derivative of order %d of %s: only order 1 is used", (int)order[i],
                          VARIABLE[vr[i]].name);
        if (!core_finite(value[i]))
            return report(m, fmi2Error, "derivative of %s = %.9g is not a finite number", VARIABLE[vr[i]].name,
                          value[i]);
    }
    for (size_t i = 0; i < n; ++i) m->s.rates[vr[i]] = value[i];
    m->s.has_rates = n || m->s.has_rates;
    return fmi2OK;
}

/* Step with Real inputs that change linearly; motion loads are interpolated between the step's ends. Afterwards the
 * inputs are at the ends of their ramps, and are held there until they or their derivatives are set again. */
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
        for (size_t i = 0; i < CORE_MOTION_LOADS; ++i)
            slopes[i] = (motion_loads[fin][i] - m->motion_loads[fin][i]) / size;
        core_inputs rates;
        acting(m, fin, m->s.rates, slopes, &rates); /* linear: rates in, rates out */
        ramp[fin] = (core_ramp){.begin = begin, .command = rates.command, .supply = rates.supply};
        memcpy(ramp[fin].loads, rates.loads, sizeof ramp[fin].loads);
        memcpy(ramp[fin].further, rates.further, sizeof ramp[fin].further);
    }
    const core_result result = run(m, end, in, ramp);
    if (result == CORE_DONE) {
        memcpy(m->s.values, final, sizeof final);
        memcpy(m->motion_loads, motion_loads, sizeof motion_loads);
        memset(m->s.rates, 0, sizeof m->s.rates);
        m->s.has_rates = 0;
    }
    return result;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_set_state)
{
    instance *m = c;
    double end = 0.0;
    if (!allowed(m, RUNNING, __func__)) return fmi2Error;
    int status = step_end(m, time, size, &end);
    if (status == fmi2OK) {
        const double begin = time - m->s.start;
        const bool ramped = m->s.has_rates && end > begin;
        status = step_done(m, ramped ? ramped_step(m, begin, end) : held_step(m, end), time, size, end);
        /* With several fins, outputs at the ends of ramps may differ by rounding from those for the final inputs. */
        if (FINS > 1 && ramped && status == fmi2OK) m->s.fresh = 0;
    }
    if (status != fmi2Error) m->s.terminated = status != fmi2OK; /* without it fmpy repeats a discarded step for ever */
    return status;
}

UNSUPPORTED(CancelStep, ANY_PHASE, 1, "steps are not asynchronous", (fmi2Component c))

/* Define a function that returns the status `found` for the kind `available`, and refuses other kinds. */
#define DEFINE_STATUS(Name, type, available, found)                                                             \
    fmi2Status fmi2Get##Name(fmi2Component c, const fmi2StatusKind kind, fmi2##type *value)                      \
    {                                                                                                           \
        const instance *m = c;                                                                                  \
        if (!allowed_with(m, RUNNING | TERMINATED, 1, value, value, __func__)) return fmi2Error;                \
        if ((int)kind != available)                                                                             \
            return report(m, fmi2Discard, "%s: status kind %d is not available", __func__, (int)kind);          \
        *value = found;                                                                                         \
        return fmi2OK;                                                                                          \
    }

enum { NO_KIND = -1 };

DEFINE_STATUS(Status, Status, NO_KIND, fmi2OK)
DEFINE_STATUS(RealStatus, Real, fmi2LastSuccessfulTime, m->s.start + m->s.now)
DEFINE_STATUS(IntegerStatus, Integer, NO_KIND, 0)
DEFINE_STATUS(BooleanStatus, Boolean, fmi2Terminated, m->s.terminated ? fmi2True : fmi2False)
DEFINE_STATUS(StringStatus, String, NO_KIND, NULL)

const char *fmi2GetTypesPlatform(void)
{
    return fmi2TypesPlatform;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
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

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    if (!allowed(c, INSTANTIATED, __func__)) return fmi2Error;
    return begin_initialization(c, start, stop_defined, stop);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c)
{
    instance *m = c;
    if (!allowed(m, INSTANTIATED, __func__)) return fmi2Error;
    m->s.phase = INITIALIZING;
    return fmi2OK;
}
