/* FMI 2.0 for co-simulation around core.h.
 *
 * A variable's value reference is its place in the table: inputs, outputs, parameters. There
 * is no global state that changes and no allocation while stepping.
 */
#include "instance.h"

#include "states.h"

/* -- variables ---------------------------------------------------------------- */

/* Whether a value may be set; nothing is written before all of a call have been looked at. A NaN
 * input may: the step it is meant for is refused. */
static bool settable(const instance *m, size_t vr, int kind, double value)
{
    const bool early = m->s.phase & (INSTANTIATED | INITIALIZING);
    if (vr >= UNIT_VARIABLES || VARIABLE[vr].kind != kind)
        report(m, fmi2Error, "no %s variable has value reference %u", KIND[kind], (unsigned)vr);
    else if (vr >= OUTPUT_BEGIN && vr < PARAMETER_BEGIN)
        report(m, fmi2Error, "%s is an output and cannot be set", VARIABLE[vr].name);
    else if (vr < OUTPUT_BEGIN || early)
        return true;
    else if (!VARIABLE[vr].tunable)
        report(m, fmi2Error, "%s is fixed and cannot be set after initialization", VARIABLE[vr].name);
    else
        return !out_of_range(m, vr, value);
    return false;
}

static void set_one(instance *m, size_t vr, double value)
{
    m->s.values[vr] = value;
    m->s.fresh = 0;
    if (!core_finite(value)) m->check_inputs = 1;
    if (vr >= PARAMETER_BEGIN) m->unprepared = 1;
    if (vr - MOTION_BEGIN < MODEL_MOTION) m->moved = 1; /* unsigned: none below */
}

static bool array_missing(const instance *m, size_t n, const void *vr, const void *value, const char *function)
{
    if (n == 0 || (vr && value)) return false;
    report(m, fmi2Error, "%s: no array given", function);
    return true;
}

#define DEFINE_SET(Kind, expected, converted)                                                                   \
    fmi2Status fmi2Set##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Kind value[]) \
    {                                                                                                           \
        instance *m = c;                                                                                        \
        bool good = true;                                                                                       \
        if (!allowed(m, ANY_PHASE & ~TERMINATED, "fmi2Set" #Kind)) return fmi2Error;                            \
        if (array_missing(m, n, vr, value, "fmi2Set" #Kind)) return fmi2Error;                                  \
        for (size_t i = 0; i < n; ++i) good &= settable(m, vr[i], expected, converted(value[i]));               \
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
            if (vr[i] < UNIT_VARIABLES && VARIABLE[vr[i]].kind == expected)                                    \
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
/* Neither can hold a NaN or a number too large: they come in as what they are. */
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

static fmi2Status bad_inputs(const instance *m, double time)
{
    fmi2Status status = fmi2OK;
    for (size_t i = 0; i < UNIT_INPUTS; ++i)
        if (!core_finite(m->s.values[i]))
            status = report(m, fmi2Error, "input at %.17g s is not finite: %s = %.9g", time, VARIABLE[i].name,
                            m->s.values[i]);
    return status;
}

static fmi2Status refused_step(instance *m, core_result result, double time, double size)
{
    m->s.terminated = 1; /* else fmpy asks for the same step for ever */
    if (result == CORE_TOO_MANY_TICKS)
        return report(m, fmi2Discard, "step from %.17g s of %.17g s has more than %d ticks", time, size,
                      CORE_MOST_TICKS);
    if (result == CORE_TOO_MANY_EVENTS)
        return report(m, fmi2Discard, "step from %.17g s of %.17g s: more than %d events in a tick", time, size,
                      CORE_MOST_EVENTS);
    return report(m, fmi2Discard, "step from %.17g s of %.17g s: the state is no longer finite", time, size);
}

static core_result run(instance *m, double end, const core_inputs *in, const core_ramp *ramp)
{
    return multi_fin_run(&m->fins, &m->s.fins, m->s.now, end, in, ramp, m->s.values + OUTPUT_BEGIN);
}

/* A step in which the inputs change: of the vehicle's motion by what it makes at its ends. The inputs then stand
 * at the end of their ramps, and are held there until they are set or given derivatives again. */
static core_result ramped_step(instance *m, double begin, double end)
{
    double final[UNIT_INPUTS], carried[FINS][CORE_CARRIED];
    const double size = end - begin;
    core_inputs in[FINS];
    core_ramp ramp[FINS];
    for (size_t i = 0; i < UNIT_INPUTS; ++i) final[i] = m->s.values[i] + m->s.rates[i] * size;
    if (!(size > 0.0) || !core_all_finite(final, UNIT_INPUTS)) return CORE_NOT_FINITE;
    carry(m, final, carried);
    acting_now(m, in);
    for (size_t fin = 0; fin < FINS; ++fin) {
        double slopes[CORE_CARRIED];
        for (size_t i = 0; i < CORE_CARRIED; ++i) slopes[i] = (carried[fin][i] - m->carried[fin][i]) / size;
        core_inputs rates;
        acting(m, fin, m->s.rates, slopes, &rates); /* linear in all but these */
        ramp[fin] = (core_ramp){.begin = begin, .command = rates.command, .supply = rates.supply};
        memcpy(ramp[fin].loads, rates.loads, sizeof ramp[fin].loads);
        memcpy(ramp[fin].further, rates.further, sizeof ramp[fin].further);
    }
    const core_result result = run(m, end, in, ramp);
    if (result == CORE_DONE) {
        memcpy(m->s.values, final, sizeof final);
        memcpy(m->carried, carried, sizeof carried);
        memset(m->s.rates, 0, sizeof m->s.rates);
        m->s.rated = 0;
    }
    return result;
}

static core_result held_step(instance *m, double end)
{
    core_inputs in[FINS];
    acting_now(m, in);
    return run(m, end, in, NULL);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_set_state)
{
    instance *m = c;
    (void)no_set_state;
    if (!allowed(m, RUNNING, "fmi2DoStep")) return fmi2Error;
    if (!core_finite(time) || !core_finite(size) || !(size > 0.0))
        return report(m, fmi2Error, "communication step %.17g s at %.17g s is not positive and finite", size, time);
    if (m->check_inputs) {
        if (!core_all_finite(m->s.values, UNIT_INPUTS)) return bad_inputs(m, time);
        m->check_inputs = 0;
    }
    if (m->unprepared) {
        prepare(m);
        warn(m);
    }
    const double begin = time - m->s.start;
    /* A clock that began late counts in coarser units than the slack. */
    if (!(fabs(begin - m->s.now) <= m->fins.slack + 4.0 * DBL_EPSILON * fabs(time)))
        return report(m, fmi2Error, "step from %.17g s, but the slave stands at %.17g s, %.3g s away", time,
                      m->s.start + m->s.now, begin - m->s.now);
    double end = begin + size;
    if (end < m->s.now) end = m->s.now; /* a host's clock may run back within the slack, the trajectory does not */
    if (m->moved) carry_now(m);
    const core_result result = m->s.rated && end > begin ? ramped_step(m, begin, end) : held_step(m, end);
    if (result != CORE_DONE) return refused_step(m, result, time, size);
    m->s.fresh = 1;
    m->s.now = end;
    m->s.terminated = 0;
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c)
{
    const instance *m = c;
    return m ? report(m, fmi2Error, "fmi2CancelStep: steps are not asynchronous") : fmi2Error;
}

/* Whether a status of a kind may be written to `value`: the one `available`, if any (NO_STATUS). */
static fmi2Status status_of(const instance *m, int kind, int available, const char *function, const void *value)
{
    if (!allowed(m, RUNNING | TERMINATED, function)) return fmi2Error;
    if (!value) return report(m, fmi2Error, "%s: nowhere to put it", function);
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

static void as_instantiated(instance *m)
{
    memset(&m->s, 0, sizeof m->s);
    memcpy(m->s.values, START, sizeof START);
    m->s.phase = INSTANTIATED;
    m->unprepared = m->moved = m->check_inputs = 1;
    memset(m->warned, 0, sizeof m->warned);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible;
    if (!functions) return NULL;
    const bool named = name && *name;
    const size_t length = named ? strlen(name) + 1 : 0;
    /* For reports if there will be no instance. */
    const instance none = {
        .callbacks = *functions, .name = named ? name : MODEL_NAME, .logged = logging ? EVERY_CATEGORY : 0};
    instance *m = NULL;
    if (!named)
        report(&none, fmi2Error, "the instance has no name");
    else if (type != fmi2CoSimulation)
        report(&none, fmi2Error, "only fmi2CoSimulation is supported, not type %d", (int)type);
    else if (!guid || strcmp(guid, MODEL_GUID) != 0)
        report(&none, fmi2Error, "the GUID asked for is %s, this unit's is %s", guid ? guid : "none", MODEL_GUID);
    else if (!functions->allocateMemory != !functions->freeMemory)
        report(&none, fmi2Error, "allocateMemory and freeMemory must be given together");
    else if (!(m = allocate(functions, sizeof *m + length)))
        report(&none, fmi2Error, "no memory for an instance");
    if (!m) return NULL;
    *m = none;
    m->name = memcpy(m + 1, name, length);
    as_instantiated(m);
    return m;
}

void fmi2FreeInstance(fmi2Component c)
{
    instance *m = c;
    if (!m) return;
    const fmi2CallbackFunctions callbacks = m->callbacks;
    release(&callbacks, m);
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[])
{
    instance *m = c;
    uint32_t chosen = n ? 0 : EVERY_CATEGORY;
    if (!m) return fmi2Error;
    if (array_missing(m, n, categories, categories, "fmi2SetDebugLogging")) return fmi2Error;
    for (size_t i = 0; i < n; ++i) {
        unsigned k = 0;
        while (k < CATEGORIES && (!categories[i] || strcmp(categories[i], CATEGORY[k]) != 0)) ++k;
        if (k == CATEGORIES)
            return report(m, fmi2Error, "there is no log category %s", categories[i] ? categories[i] : "(null)");
        chosen |= k == LOG_ALL ? EVERY_CATEGORY : 1u << k;
    }
    m->logged = on ? chosen : m->logged & ~chosen;
    return fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean tolerance_defined, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean stop_defined, fmi2Real stop)
{
    instance *m = c;
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    if (!allowed(m, INSTANTIATED, "fmi2SetupExperiment")) return fmi2Error;
    if (!core_finite(start)) return report(m, fmi2Error, "start time %.9g is not finite", start);
    m->s.start = start;
    return fmi2OK;
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
    instance *m = c;
    if (!allowed(m, INITIALIZING, "fmi2ExitInitializationMode")) return fmi2Error;
    if (!sound(m)) return fmi2Error; /* parameters may be corrected and the call repeated */
    prepare(m);
    warn(m);
    multi_fin_start(&m->fins, &m->s.fins);
    m->s.phase = RUNNING;
    m->s.fresh = 0;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c)
{
    instance *m = c;
    if (!allowed(m, RUNNING, "fmi2Terminate")) return fmi2Error;
    if (!m->s.fresh) refresh(m);
    m->s.phase = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c)
{
    instance *m = c;
    if (!m) return fmi2Error;
    as_instantiated(m);
    return fmi2OK;
}
