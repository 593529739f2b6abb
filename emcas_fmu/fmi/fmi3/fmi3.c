/* FMI 3.0 for co-simulation around core.h.
 *
 * A variable is a scalar or an array; ARRAY (interface.h) has the indices of its elements among the scalars of the
 * FMU. There are no global variables that change, and no step allocates memory.
 */
#include <stdbool.h>
#include <stdlib.h>

#ifdef __GNUC__ /* the standard has parameters that the FMU does not need, and functions without prototypes */
#pragma GCC diagnostic ignored "-Wunused-parameter"
#pragma GCC diagnostic ignored "-Wstrict-prototypes"
#endif
#include "interface.h"
#include "fmi3Functions.h"

/* The name of a function or type. */
#define FMI(name) FMI_PASTE(fmi3, name)
#define FMI_PASTE(version, name) version##name
#define GUID_NAME "instantiation token"

typedef struct {
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback logger;
} host_services;

static void log_message(const host_services *host, const char *name, int status, const char *category, char *text)
{
    if (host->logger) host->logger(host->environment, (fmi3Status)status, category, text);
}

static void *allocate(const host_services *host, size_t size)
{
    return calloc(1, size);
}

static void release(const host_services *host, void *block)
{
    free(block);
}

#include "instance.h"
#include "life_cycle.h"
#include "states.h"
#include "step.h"

#include "absent.h"
#include "events.h"

/* Return whether a function may be called now for variables of a type with a total of `count` elements; log an error
 * if not. */
static bool are_of(const instance *m, int phases, int type, const fmi3ValueReference vr[], size_t n, const void *value,
                   size_t count, const char *function)
{
    size_t elements = 0;
    if (!allowed_with(m, phases, n, vr, value, function)) return false;
    for (size_t i = 0; i < n; ++i) {
        if (vr[i] >= ARRAYS || ARRAY[vr[i]].type != type) {
            report(m, fmi3Error, NO_VARIABLE, TYPE[type], (unsigned)vr[i]);
            return false;
        }
        elements += ARRAY[vr[i]].size * ARRAY[vr[i]].fins;
    }
    if (elements == count) return true;
    report(m, fmi3Error, "%s: the variables have %lu elements, the call has %lu values", function,
           (unsigned long)elements, (unsigned long)count);
    return false;
}

/* Return the index of an element of a variable among the scalars of the FMU. Elements are counted fin by fin. */
static size_t scalar_index(const array *v, size_t element)
{
    return v->first + element / v->size * v->stride + element % v->size;
}

static double value_at(const instance *m, size_t vr, size_t element)
{
    return vr == TIME ? m->s.start + m->s.now : m->s.values[scalar_index(&ARRAY[vr], element)];
}

static bool may_be_set(const instance *m, size_t vr, size_t element, double value)
{
    if (vr != TIME) return settable(m, scalar_index(&ARRAY[vr], element), value);
    report(m, fmi3Error, "%s is set by the steps, not by the host", ARRAY[vr].name);
    return false;
}

/* Loop over the variables `i` of a call and their elements `e`; `k` counts all elements. */
#define EACH_ELEMENT                                                                                              \
    for (size_t i = 0, k = 0; i < n; ++i)                                                                         \
        for (size_t e = 0; e < ARRAY[vr[i]].size * ARRAY[vr[i]].fins; ++e, ++k)

/* The conversions lose nothing: a call gets and sets only variables of its type. */
#define DEFINE_ACCESS(Kind, type)                                                                                 \
    fmi3Status fmi3Get##Kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##Kind value[],          \
                             size_t count)                                                                         \
    {                                                                                                             \
        instance *m = c;                                                                                          \
        if (!are_of(m, ANY_PHASE, type, vr, n, value, count, __func__)) return fmi3Error;                         \
        if (!m->s.fresh) refresh(m);                                                                              \
        EACH_ELEMENT value[k] = (fmi3##Kind)value_at(m, vr[i], e);                                                \
        return fmi3OK;                                                                                            \
    }                                                                                                             \
    fmi3Status fmi3Set##Kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##Kind value[],    \
                             size_t count)                                                                         \
    {                                                                                                             \
        instance *m = c;                                                                                          \
        bool good = true;                                                                                         \
        if (!are_of(m, BEFORE_END, type, vr, n, value, count, __func__)) return fmi3Error;                        \
        EACH_ELEMENT good &= may_be_set(m, vr[i], e, (double)value[k]);                                           \
        if (!good) return fmi3Error;                                                                              \
        EACH_ELEMENT set_one(m, scalar_index(&ARRAY[vr[i]], e), (double)value[k]);                                \
        return fmi3OK;                                                                                            \
    }

DEFINE_ACCESS(Float64, FLOAT64)
DEFINE_ACCESS(Int32, INT32)
DEFINE_ACCESS(UInt32, UINT32)
DEFINE_ACCESS(Int64, INT64)
DEFINE_ACCESS(Boolean, BOOL)

#include "clock.h"

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 size, fmi3Boolean no_set_state,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate_simulation, fmi3Boolean *early_return,
                      fmi3Float64 *reached)
{
    instance *m = c;
    double end = 0.0;
    bool event = false;
    if (!allowed(m, RUNNING, __func__)) return fmi3Error;
    if (!event_needed || !terminate_simulation || !early_return || !reached)
        return report(m, fmi3Error, "%s: an argument is missing", __func__);
    int status = step_end(m, time, size, &end);
    const double requested = end;
    if (status == fmi3OK) {
        if (m->event_mode && !m->s.fresh) refresh(m);
        const core_result result = !m->event_mode  ? held_step(m, end)
                                 : m->early_return ? step_to_event(m, &end, &event)
                                                   : step_over_events(m, end, &event);
        status = step_done(m, result, time, size, end);
    }
    *event_needed = event;
    *terminate_simulation = false;
    *early_return = status == fmi3OK && end < requested;
    *reached = m->s.start + m->s.now;
    return status;
}

fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    instance *m = c;
    if (!allowed(m, RUNNING, __func__)) return fmi3Error;
    if (!m->event_mode)
        return report(m, fmi3Error, "%s: the instance was created without event mode", __func__);
    m->s.phase = HANDLING_EVENT;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    instance *m = c;
    if (!allowed(m, HANDLING_EVENT, __func__)) return fmi3Error;
    m->ticks = false;
    m->s.phase = RUNNING;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *more, fmi3Boolean *terminate_simulation,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *states_changed, fmi3Boolean *timed,
                                    fmi3Float64 *next_time)
{
    instance *m = c;
    if (!allowed(m, HANDLING_EVENT, __func__)) return fmi3Error;
    if (!more || !terminate_simulation || !nominals_changed || !states_changed || !timed || !next_time)
        return report(m, fmi3Error, "%s: an argument is missing", __func__);
    *more = *terminate_simulation = *nominals_changed = *states_changed = *timed = false;
    *next_time = 0.0;
    m->ticks = false;
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update)
{
    const host_services host = {environment, logger};
    instance *m = new_instance(&host, name, token, logging);
    if (m) {
        m->event_mode = event_mode;
        m->early_return = early_return;
    }
    return m;
}

/* Log that a kind of simulation is not supported; return no instance. */
static fmi3Instance no_instance(fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger, const char *kind)
{
    const instance none = {.host = {.environment = environment, .logger = logger}, .logged = EVERY_CATEGORY};
    report(&none, fmi3Error, "%s is for co-simulation, not for %s", MODEL_NAME, kind);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    return no_instance(environment, logger, "model exchange");
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    return no_instance(environment, logger, "scheduled execution");
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    instance *m = c;
    if (!allowed(m, INSTANTIATED, __func__)) return fmi3Error;
    if (begin_initialization(m, start, stop_defined, stop) != fmi3OK) return fmi3Error;
    m->s.phase = INITIALIZING;
    return fmi3OK;
}
