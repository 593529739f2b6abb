/* FMI 3.0 for co-simulation around core.h.
 *
 * A variable is a scalar or an array; ARRAY (interface.h) gives the indices of its elements among the scalars of the
 * FMU. There is no global state that changes and no allocation while stepping.
 */
#include <stdbool.h>
#include <stdlib.h>

#ifdef __clang__ /* the standard's header has functions without prototypes */
#pragma clang diagnostic push
#pragma clang diagnostic ignored "-Wstrict-prototypes"
#endif
#include "fmi3Functions.h"
#ifdef __clang__
#pragma clang diagnostic pop
#endif

#define GUID_NAME "instantiation token"

/* The arguments of instantiation, and two flags of the clock that are not part of the state: whether it ticks in this
 * event, and whether the host knows its interval. */
typedef struct {
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback logger;
    bool event_mode, early_return, ticks, interval_known;
} host_services;

static void log_message(const host_services *host, const char *name, int status, const char *category, char *text)
{
    (void)name;
    if (host->logger) host->logger(host->environment, (fmi3Status)status, category, text);
}

static void *allocate(const host_services *host, size_t size)
{
    (void)host;
    return calloc(1, size);
}

static void release(const host_services *host, void *block)
{
    (void)host;
    free(block);
}

static bool handles_events(const host_services *host)
{
    return host->event_mode;
}

#include "instance.h"
#include "states.h"
#include "step.h"

#include "absent.h"
#include "clock.h"
#include "events.h"

_Static_assert((int)STATUS_OK == (int)fmi3OK && (int)STATUS_WARNING == (int)fmi3Warning
               && (int)STATUS_DISCARD == (int)fmi3Discard && (int)STATUS_ERROR == (int)fmi3Error, "fmi3Status");

/* -- variables ---------------------------------------------------------------- */

/* Return the index of an element of a variable among the scalars of the FMU. Elements are counted fin by fin. */
static size_t scalar_index(const array *v, size_t element)
{
    return v->first + element / v->size * v->stride + element % v->size;
}

/* Return whether the variables are of a type and have `count` elements in all; log an error if not. */
static bool are_of(const instance *m, int type, const fmi3ValueReference vr[], size_t n, const void *value,
                   size_t count, const char *function)
{
    size_t elements = 0;
    if (array_missing(m, n, vr, value, function)) return false;
    for (size_t i = 0; i < n; ++i) {
        if (vr[i] >= ARRAYS || ARRAY[vr[i]].type != type) {
            report(m, STATUS_ERROR, "%s: no %s variable has value reference %u", function, TYPE[type],
                   (unsigned)vr[i]);
            return false;
        }
        elements += ARRAY[vr[i]].size * ARRAY[vr[i]].fins;
    }
    if (elements == count) return true;
    report(m, STATUS_ERROR, "%s: the variables have %lu elements, the call has %lu values", function,
           (unsigned long)elements, (unsigned long)count);
    return false;
}

static double value_at(const instance *m, size_t vr, size_t element)
{
    return vr == TIME ? m->s.start + m->s.now : m->s.values[scalar_index(&ARRAY[vr], element)];
}

static bool may_be_set(const instance *m, size_t vr, size_t element, double value)
{
    if (vr != TIME) return settable(m, scalar_index(&ARRAY[vr], element), value);
    report(m, STATUS_ERROR, "%s is set by the steps", ARRAY[vr].name);
    return false;
}

#define DEFINE_SET(Kind, type)                                                                                    \
    fmi3Status fmi3Set##Kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##Kind value[],    \
                             size_t count)                                                                         \
    {                                                                                                             \
        instance *m = c;                                                                                          \
        if (!allowed(m, ANY_PHASE & ~TERMINATED, "fmi3Set" #Kind)) return fmi3Error;                              \
        if (!are_of(m, type, vr, n, value, count, "fmi3Set" #Kind)) return fmi3Error;                             \
        bool good = true;                                                                                         \
        for (size_t i = 0, k = 0; i < n; ++i)                                                                     \
            for (size_t e = 0; e < ARRAY[vr[i]].size * ARRAY[vr[i]].fins; ++e, ++k)                               \
                good &= may_be_set(m, vr[i], e, (double)value[k]);                                                \
        for (size_t i = 0, k = 0; good && i < n; ++i)                                                             \
            for (size_t e = 0; e < ARRAY[vr[i]].size * ARRAY[vr[i]].fins; ++e, ++k)                               \
                set_one(m, scalar_index(&ARRAY[vr[i]], e), (double)value[k]);                                            \
        return good ? fmi3OK : fmi3Error;                                                                         \
    }

#define DEFINE_GET(Kind, type)                                                                                    \
    fmi3Status fmi3Get##Kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##Kind value[],          \
                             size_t count)                                                                         \
    {                                                                                                             \
        instance *m = c;                                                                                          \
        if (!allowed(m, ANY_PHASE, "fmi3Get" #Kind)) return fmi3Error;                                            \
        if (!are_of(m, type, vr, n, value, count, "fmi3Get" #Kind)) return fmi3Error;                             \
        if (!m->s.fresh) refresh(m);                                                                              \
        for (size_t i = 0, k = 0; i < n; ++i)                                                                     \
            for (size_t e = 0; e < ARRAY[vr[i]].size * ARRAY[vr[i]].fins; ++e, ++k)                               \
                value[k] = (fmi3##Kind)value_at(m, vr[i], e);                                                     \
        return fmi3OK;                                                                                            \
    }

DEFINE_GET(Float64, FLOAT64)
/* These values are always in the range of their type: they are checked when they are set. */
DEFINE_GET(Int32, INT32)
DEFINE_GET(UInt32, UINT32)
DEFINE_GET(Int64, INT64)
DEFINE_GET(Boolean, BOOL)
DEFINE_SET(Float64, FLOAT64)
DEFINE_SET(Int32, INT32)
DEFINE_SET(UInt32, UINT32)
DEFINE_SET(Int64, INT64)
DEFINE_SET(Boolean, BOOL)

static fmi3Status none_of(const instance *m, int phases, size_t n, const char *function)
{
    if (!allowed(m, phases, function)) return fmi3Error;
    return n ? report(m, STATUS_ERROR, "%s: there is no variable of this type", function) : fmi3OK;
}

#define NONE_OF(Kind)                                                                                             \
    fmi3Status fmi3Get##Kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##Kind value[],          \
                             size_t count)                                                                         \
    {                                                                                                             \
        (void)vr, (void)value, (void)count;                                                                       \
        return none_of(c, ANY_PHASE, n, "fmi3Get" #Kind);                                                         \
    }                                                                                                             \
    fmi3Status fmi3Set##Kind(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##Kind value[],    \
                             size_t count)                                                                         \
    {                                                                                                             \
        (void)vr, (void)value, (void)count;                                                                       \
        return none_of(c, ANY_PHASE & ~TERMINATED, n, "fmi3Set" #Kind);                                           \
    }

NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(UInt64)
NONE_OF(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary value[],
                         size_t count)
{
    (void)vr, (void)sizes, (void)value, (void)count;
    return none_of(c, ANY_PHASE, n, "fmi3GetBinary");
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
                         const fmi3Binary value[], size_t count)
{
    (void)vr, (void)sizes, (void)value, (void)count;
    return none_of(c, ANY_PHASE & ~TERMINATED, n, "fmi3SetBinary");
}

/* -- stepping ----------------------------------------------------------------- */

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 size, fmi3Boolean no_set_state,
                      fmi3Boolean *event_needed, fmi3Boolean *terminate_simulation, fmi3Boolean *early_return,
                      fmi3Float64 *reached)
{
    instance *m = c;
    double end = 0.0;
    bool event = false;
    (void)no_set_state;
    if (!allowed(m, RUNNING, "fmi3DoStep")) return fmi3Error;
    if (!event_needed || !terminate_simulation || !early_return || !reached)
        return report(m, STATUS_ERROR, "fmi3DoStep: argument missing");
    if (step_end(m, time, size, &end) != STATUS_OK) return fmi3Error;
    if (m->host.event_mode && !m->s.fresh) refresh(m);
    const double requested = end;
    const core_result result = !m->host.event_mode  ? held_step(m, end)
                             : m->host.early_return ? step_to_event(m, &end, &event)
                                                    : step_over_events(m, end, &event);
    const int status = step_done(m, result, time, size, end);
    *event_needed = event;
    *terminate_simulation = false;
    *early_return = status == STATUS_OK && end < requested;
    *reached = m->s.start + m->s.now;
    return status;
}

fmi3Status fmi3EnterEventMode(fmi3Instance c)
{
    instance *m = c;
    if (!allowed(m, RUNNING, "fmi3EnterEventMode")) return fmi3Error;
    if (!m->host.event_mode)
        return report(m, STATUS_ERROR, "fmi3EnterEventMode: the instance was created without event mode");
    m->s.phase = HANDLING_EVENT;
    return fmi3OK;
}

fmi3Status fmi3EnterStepMode(fmi3Instance c)
{
    instance *m = c;
    if (!allowed(m, HANDLING_EVENT, "fmi3EnterStepMode")) return fmi3Error;
    m->host.ticks = false;
    m->s.phase = RUNNING;
    return fmi3OK;
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *more, fmi3Boolean *terminate_simulation,
                                    fmi3Boolean *nominals_changed, fmi3Boolean *states_changed, fmi3Boolean *timed,
                                    fmi3Float64 *next_time)
{
    instance *m = c;
    if (!allowed(m, HANDLING_EVENT, "fmi3UpdateDiscreteStates")) return fmi3Error;
    if (!more || !terminate_simulation || !nominals_changed || !states_changed || !timed || !next_time)
        return report(m, STATUS_ERROR, "fmi3UpdateDiscreteStates: argument missing");
    *more = *terminate_simulation = *nominals_changed = *states_changed = *timed = false;
    *next_time = 0.0;
    m->host.ticks = false;
    return fmi3OK;
}

/* -- life cycle --------------------------------------------------------------- */

const char *fmi3GetVersion(void)
{
    return fmi3Version;
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean event_mode, fmi3Boolean early_return,
                                         const fmi3ValueReference intermediate[], size_t n_intermediate,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update)
{
    const host_services host = {environment, logger, event_mode, early_return, false, false};
    (void)resources, (void)visible, (void)intermediate, (void)n_intermediate, (void)update;
    return new_instance(&host, name, token, logging);
}

/* Log that a kind of simulation is not supported. */
static fmi3Instance no_instance(fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger, const char *kind)
{
    const instance none = {.host = {.environment = environment, .logger = logger}, .logged = EVERY_CATEGORY};
    report(&none, STATUS_ERROR, "%s is for co-simulation, not for %s", MODEL_NAME, kind);
    return NULL;
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging;
    return no_instance(environment, logger, "model exchange");
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources,
                                               fmi3Boolean visible, fmi3Boolean logging,
                                               fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                               fmi3ClockUpdateCallback update, fmi3LockPreemptionCallback lock,
                                               fmi3UnlockPreemptionCallback unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)update, (void)lock, (void)unlock;
    return no_instance(environment, logger, "scheduled execution");
}

void fmi3FreeInstance(fmi3Instance c)
{
    free_instance(c);
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    return c ? choose_categories(c, on, n, categories, "fmi3SetDebugLogging") : fmi3Error;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean tolerance_defined, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean stop_defined, fmi3Float64 stop)
{
    instance *m = c;
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    if (!allowed(m, INSTANTIATED, "fmi3EnterInitializationMode")) return fmi3Error;
    if (begin_initialization(m, start) != STATUS_OK) return fmi3Error;
    m->s.phase = INITIALIZING;
    return fmi3OK;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c)
{
    instance *m = c;
    if (!allowed(m, INITIALIZING, "fmi3ExitInitializationMode")) return fmi3Error;
    return finish_initialization(m, m->host.event_mode ? HANDLING_EVENT : RUNNING);
}

fmi3Status fmi3Terminate(fmi3Instance c)
{
    return allowed(c, DURING_RUN, "fmi3Terminate") ? terminate(c) : fmi3Error;
}

fmi3Status fmi3Reset(fmi3Instance c)
{
    instance *m = c;
    if (!m) return fmi3Error;
    reset_instance(m);
    m->host.ticks = m->host.interval_known = false;
    return fmi3OK;
}

/* -- states ------------------------------------------------------------------- */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state)
{
    return copy_state(c, state, "fmi3GetFMUState");
}

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state)
{
    instance *m = c;
    const fmi3Status status = restore_state(m, state, "fmi3SetFMUState");
    if (status == fmi3OK) m->host.ticks = false;
    return status;
}

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state)
{
    return free_state(c, state);
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size)
{
    return serialized_size(c, state, size, "fmi3SerializedFMUStateSize");
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size)
{
    return serialize(c, state, bytes, size, "fmi3SerializeFMUState");
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state)
{
    return deserialize(c, bytes, size, state, "fmi3DeserializeFMUState");
}
