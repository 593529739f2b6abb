/* FMI 2.0 for co-simulation around core.h.
 *
 * interface.h is generated from the variable table: names, kinds, limits, start values,
 * rules for parameter sets. A variable's value reference is its place in the table: inputs,
 * outputs, parameters. There is no global state that changes and no allocation while stepping.
 */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2Functions.h"

#include "core.h"
#include "interface.h"

typedef enum { INSTANTIATED = 1, INITIALIZING = 2, RUNNING = 4, TERMINATED = 8 } phase;

enum {
    ANY_PHASE = INSTANTIATED | INITIALIZING | RUNNING | TERMINATED,
    OUTPUT_BEGIN = MODEL_INPUTS,
    PARAMETER_BEGIN = MODEL_INPUTS + MODEL_OUTPUTS,
    MESSAGE = 1024
};

/* All that reset and the FMU state functions copy. */
typedef struct {
    double values[MODEL_VARIABLES];
    double rates[MODEL_INPUTS]; /* of the inputs, for the next step */
    double start, now;          /* now counts from the start */
    int32_t phase;
    int32_t rated;      /* some rate was given */
    int32_t terminated; /* the last step could not be followed */
    int32_t fresh;      /* the outputs in values are those of now */
    core_state core;
} model_state;

typedef struct {
    fmi2CallbackFunctions callbacks;
    fmi2String name;
    uint32_t logged;    /* a bit for each category */
    int32_t unprepared; /* constants are not those of the parameters */
    double slack;
    double force[2], constants[KERNEL_CONSTANTS];
    model_state s;
} instance;

/* Serialized: this before a model_state. */
typedef struct {
    char magic[40];
    uint64_t check;
} state_head;

/* -- logging ------------------------------------------------------------------ */

static const char *const CATEGORY[] = LOG_CATEGORIES;
enum {
    CATEGORIES = sizeof CATEGORY / sizeof *CATEGORY,
    LOG_ALL = CATEGORIES - 1,
    EVERY_CATEGORY = (1 << CATEGORIES) - 1
};

/* Gives its status, so that a refusal is one line. */
static fmi2Status report(const instance *m, fmi2Status status, const char *format, ...)
{
    const unsigned category = (unsigned)status - fmi2Warning;
    if (m->callbacks.logger && (m->logged & 1u << category)) {
        char text[MESSAGE];
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(text, sizeof text, format, arguments);
        va_end(arguments);
        /* As a format of its own: hosts in other languages cannot follow variable arguments. */
        for (char *at = text; *at; ++at)
            if (*at == '%') *at = '/';
        m->callbacks.logger(m->callbacks.componentEnvironment, m->name, status, CATEGORY[category], text);
    }
    return status;
}

static const char *phase_name(int32_t at)
{
    return at == INSTANTIATED ? "instantiated" : at == INITIALIZING ? "initializing"
         : at == RUNNING      ? "running"
                              : "terminated";
}

/* Whether a call may come now; if not, it changes nothing. */
static bool allowed(const instance *m, int phases, const char *function)
{
    if (!m) return false;
    if (m->s.phase & phases) return true;
    report(m, fmi2Error, "%s called while %s", function, phase_name(m->s.phase));
    return false;
}

/* -- parameters --------------------------------------------------------------- */

static const double *parameters(const instance *m)
{
    return m->s.values + PARAMETER_BEGIN;
}

/* A value outside its variable's limits; told as `status`. */
static bool out_of_range(const instance *m, fmi2Status status, size_t vr, double value)
{
    const variable *v = &VARIABLE[vr];
    if (!core_finite(value))
        report(m, status, NOT_FINITE, v->name, value);
    else if (value < v->minimum)
        report(m, status, BELOW, v->name, value, v->minimum);
    else if (value > v->maximum)
        report(m, status, ABOVE, v->name, value, v->maximum);
    else
        return false;
    return true;
}

/* A rule's message: a format of no more than RULE_NUMBERS numbers, the rest is not looked at. */
static void tell(const instance *m, const char *message, const double *n)
{
    report(m, fmi2Error, message, n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11]);
}

/* Whether the parameters are a set to compute with; a rule's message is told if `loud`. */
static bool consistent(const instance *m, bool loud)
{
    double constants[RULES_CONSTANTS], out[RULE_NUMBERS + 1], numbers[RULE_NUMBERS + 1] = {0};
    bool good = true;
    rules_prepare(parameters(m), constants);
    for (size_t i = 0; i < sizeof RULE / sizeof *RULE; ++i) {
        double worst = -HUGE_VAL;
        for (int k = RULE[i].scanned ? -RULE_SCAN : 0; k <= (RULE[i].scanned ? RULE_SCAN : 0); ++k) {
            RULE[i].check(parameters(m), constants, (double)k / RULE_SCAN, out);
            if (out[0] > worst) {
                worst = out[0];
                memcpy(numbers, out, sizeof numbers);
            }
        }
        if (worst > 0.0) {
            good = false;
            if (loud) tell(m, RULE[i].message, numbers + 1);
        }
    }
    return good;
}

static bool sound(const instance *m, bool loud)
{
    bool good = true;
    for (size_t vr = PARAMETER_BEGIN; vr < MODEL_VARIABLES; ++vr) {
        const double value = m->s.values[vr];
        if (loud)
            good &= !out_of_range(m, fmi2Error, vr, value);
        else
            good &= core_finite(value) && value >= VARIABLE[vr].minimum && value <= VARIABLE[vr].maximum;
    }
    return good && consistent(m, loud);
}

static void prepare(instance *m)
{
    kernel_prepare(parameters(m), m->constants);
    m->slack = core_scheduled(parameters(m), m->constants).slack;
    m->unprepared = 0;
}

/* -- inputs and outputs ------------------------------------------------------- */

static bool finite_inputs(const double *in)
{
    bool good = true;
    for (size_t i = 0; i < MODEL_INPUTS; ++i) good &= core_finite(in[i]);
    return good;
}

static void forces(const instance *m, const double *in, double *out)
{
    kernel_forces(parameters(m), m->constants, in[INPUT_ACCELERATION_X], in[INPUT_ACCELERATION_Y],
                  in[INPUT_ACCELERATION_Z], in[INPUT_ATTITUDE_ROLL], in[INPUT_ATTITUDE_PITCH], out);
}

static core_inputs acting(const double *in, const double *force)
{
    return (core_inputs){in[INPUT_FIN_COMMAND], in[INPUT_AERO_TORQUE], force[0], force[1],
                         in[INPUT_SUPPLY_VOLTAGE], in[INPUT_ENABLE]};
}

/* Bring the outputs up to now. Inputs that the next step will refuse change no output. */
static void refresh(instance *m)
{
    const bool before = m->s.phase & (INSTANTIATED | INITIALIZING);
    m->s.fresh = 1;
    if (!finite_inputs(m->s.values)) return;
    if (before && !sound(m, false)) {
        for (size_t i = 0; i < MODEL_OUTPUTS; ++i)
            m->s.values[OUTPUT_BEGIN + i] = VARIABLE[OUTPUT_BEGIN + i].kind == REAL ? NAN : 0.0;
        return;
    }
    if (before || m->unprepared) prepare(m);
    if (before) core_start(parameters(m), m->constants, &m->s.core);
    forces(m, m->s.values, m->force);
    const core_schedule plan = core_scheduled(parameters(m), m->constants);
    const core_inputs now = acting(m->s.values, m->force);
    core_outputs(parameters(m), m->constants, &m->s.core, core_line_length(&plan), &now, m->s.values + OUTPUT_BEGIN);
}

static bool motion_input(size_t vr)
{
    return vr >= INPUT_ACCELERATION_X && vr <= INPUT_ATTITUDE_PITCH;
}

static fmi2Status set_one(instance *m, size_t vr, int kind, double value)
{
    if (vr >= MODEL_VARIABLES || VARIABLE[vr].kind != kind)
        return report(m, fmi2Error, "no %s variable has value reference %u", KIND[kind], (unsigned)vr);
    if (vr < OUTPUT_BEGIN) {
        m->s.values[vr] = value;
        if (motion_input(vr)) m->force[0] = NAN; /* to be found anew */
    } else if (vr < PARAMETER_BEGIN) {
        return report(m, fmi2Error, "%s is an output and cannot be set", VARIABLE[vr].name);
    } else if (m->s.phase & (INSTANTIATED | INITIALIZING)) {
        m->s.values[vr] = value;
        m->unprepared = 1;
    } else if (!VARIABLE[vr].tunable) {
        return report(m, fmi2Error, "%s is fixed and cannot be set after initialization", VARIABLE[vr].name);
    } else if (out_of_range(m, fmi2Error, vr, value)) {
        return fmi2Error;
    } else {
        m->s.values[vr] = value;
        m->unprepared = 1;
    }
    m->s.fresh = 0;
    return fmi2OK;
}

static bool array_missing(const instance *m, size_t n, const void *vr, const void *value, const char *function)
{
    if (n == 0 || (vr && value)) return false;
    report(m, fmi2Error, "%s: no array given", function);
    return true;
}

static fmi2Status worse(fmi2Status a, fmi2Status b)
{
    return a > b ? a : b;
}

#define DEFINE_SET(Kind, expected)                                                                              \
    fmi2Status fmi2Set##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Kind value[]) \
    {                                                                                                           \
        instance *m = c;                                                                                        \
        fmi2Status status = fmi2OK;                                                                             \
        if (!allowed(m, ANY_PHASE & ~TERMINATED, "fmi2Set" #Kind)) return fmi2Error;                            \
        if (array_missing(m, n, vr, value, "fmi2Set" #Kind)) return fmi2Error;                                  \
        for (size_t i = 0; i < n; ++i) status = worse(status, set_one(m, vr[i], expected, (double)value[i]));   \
        return status;                                                                                          \
    }

#define DEFINE_GET(Kind, expected)                                                                              \
    fmi2Status fmi2Get##Kind(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Kind value[])       \
    {                                                                                                           \
        instance *m = c;                                                                                        \
        fmi2Status status = fmi2OK;                                                                             \
        if (!allowed(m, ANY_PHASE, "fmi2Get" #Kind)) return fmi2Error;                                          \
        if (array_missing(m, n, vr, value, "fmi2Get" #Kind)) return fmi2Error;                                  \
        if (!m->s.fresh) refresh(m);                                                                            \
        for (size_t i = 0; i < n; ++i) {                                                                        \
            if (vr[i] < MODEL_VARIABLES && VARIABLE[vr[i]].kind == expected)                                    \
                value[i] = (fmi2##Kind)m->s.values[vr[i]];                                                      \
            else                                                                                                \
                status = report(m, fmi2Error, "no " #Kind " variable has value reference %u", (unsigned)vr[i]); \
        }                                                                                                       \
        return status;                                                                                          \
    }

DEFINE_GET(Real, REAL)
DEFINE_GET(Boolean, BOOLEAN)
DEFINE_SET(Real, REAL)
DEFINE_SET(Integer, INTEGER)

/* A NaN in an integer parameter cannot be: they come in through fmi2SetInteger only. */
DEFINE_GET(Integer, INTEGER)

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Boolean value[])
{
    instance *m = c;
    fmi2Status status = fmi2OK;
    if (!allowed(m, ANY_PHASE & ~TERMINATED, "fmi2SetBoolean")) return fmi2Error;
    if (array_missing(m, n, vr, value, "fmi2SetBoolean")) return fmi2Error;
    for (size_t i = 0; i < n; ++i) status = worse(status, set_one(m, vr[i], BOOLEAN, value[i] ? 1.0 : 0.0));
    return status;
}

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
    if (!allowed(m, INITIALIZING | RUNNING, "fmi2SetRealInputDerivatives")) return fmi2Error;
    if (array_missing(m, n, vr, value, "fmi2SetRealInputDerivatives") || (n && !order)) return fmi2Error;
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
    for (size_t i = 0; i < MODEL_INPUTS; ++i)
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

/* A step in which the inputs change: loads by the specific forces at its ends. */
static core_result ramped_step(instance *m, double begin, double end)
{
    double final[MODEL_INPUTS], force[2];
    const double size = end - begin;
    for (size_t i = 0; i < MODEL_INPUTS; ++i) final[i] = m->s.values[i] + m->s.rates[i] * size;
    if (!(size > 0.0) || !finite_inputs(final)) return CORE_NOT_FINITE;
    forces(m, final, force);
    const core_ramp ramp = {begin,
                            m->s.rates[INPUT_FIN_COMMAND],
                            m->s.rates[INPUT_AERO_TORQUE],
                            (force[0] - m->force[0]) / size,
                            (force[1] - m->force[1]) / size,
                            m->s.rates[INPUT_SUPPLY_VOLTAGE]};
    const core_inputs in = acting(m->s.values, m->force);
    const core_result result =
        core_run(parameters(m), m->constants, &m->s.core, end, &in, &ramp, m->s.values + OUTPUT_BEGIN);
    if (result == CORE_DONE) {
        memset(m->s.rates, 0, sizeof m->s.rates);
        m->s.rated = 0;
    }
    return result;
}

static core_result held_step(instance *m, double end)
{
    const core_inputs in = acting(m->s.values, m->force);
    return core_run(parameters(m), m->constants, &m->s.core, end, &in, NULL, m->s.values + OUTPUT_BEGIN);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real size, fmi2Boolean no_set_state)
{
    instance *m = c;
    (void)no_set_state;
    if (!allowed(m, RUNNING, "fmi2DoStep")) return fmi2Error;
    if (!core_finite(time) || !core_finite(size) || !(size > 0.0))
        return report(m, fmi2Error, "communication step %.17g s at %.17g s is not positive and finite", size, time);
    if (!finite_inputs(m->s.values)) return bad_inputs(m, time);
    if (m->unprepared) {
        prepare(m);
        m->force[0] = NAN;
    }
    const double begin = time - m->s.start;
    if (!(fabs(begin - m->s.now) <= m->slack))
        return report(m, fmi2Error, "step from %.17g s, but the slave stands at %.17g s", time, m->s.start + m->s.now);
    double end = begin + size;
    if (end < m->s.now) end = m->s.now; /* a host's clock may run back within the slack, the trajectory does not */
    if (!core_finite(m->force[0])) forces(m, m->s.values, m->force);
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

static fmi2Status no_status(const instance *m, int kind, const char *function)
{
    if (!allowed(m, RUNNING | TERMINATED, function)) return fmi2Error;
    return report(m, fmi2Discard, "%s: status kind %d is not available", function, kind);
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value)
{
    (void)value;
    return no_status(c, (int)kind, "fmi2GetStatus");
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value)
{
    const instance *m = c;
    if (kind != fmi2LastSuccessfulTime || !value) return no_status(m, (int)kind, "fmi2GetRealStatus");
    if (!allowed(m, RUNNING | TERMINATED, "fmi2GetRealStatus")) return fmi2Error;
    *value = m->s.start + m->s.now;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value)
{
    (void)value;
    return no_status(c, (int)kind, "fmi2GetIntegerStatus");
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value)
{
    const instance *m = c;
    if (kind != fmi2Terminated || !value) return no_status(m, (int)kind, "fmi2GetBooleanStatus");
    if (!allowed(m, RUNNING | TERMINATED, "fmi2GetBooleanStatus")) return fmi2Error;
    *value = m->s.terminated ? fmi2True : fmi2False;
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value)
{
    (void)value;
    return no_status(c, (int)kind, "fmi2GetStringStatus");
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
    m->unprepared = 1;
    m->force[0] = NAN;
}

static void *allocate(const fmi2CallbackFunctions *callbacks, size_t size)
{
    return callbacks->allocateMemory ? callbacks->allocateMemory(1, size) : calloc(1, size);
}

static void release(const fmi2CallbackFunctions *callbacks, void *block)
{
    if (callbacks->freeMemory)
        callbacks->freeMemory(block);
    else
        free(block);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging)
{
    (void)resources, (void)visible;
    if (!functions) return NULL;
    fmi2String called = name && *name ? name : MODEL_NAME;
    /* Only for what is told if there will be no instance. */
    const instance none = {.callbacks = *functions, .name = called, .logged = logging ? EVERY_CATEGORY : 0};
    if (!name || !*name) {
        report(&none, fmi2Error, "the instance has no name");
        return NULL;
    }
    if (type != fmi2CoSimulation) {
        report(&none, fmi2Error, "only fmi2CoSimulation is supported, not type %d", (int)type);
        return NULL;
    }
    if (!guid || strcmp(guid, MODEL_GUID) != 0) {
        report(&none, fmi2Error, "the GUID asked for is %s, this unit's is %s", guid ? guid : "none", MODEL_GUID);
        return NULL;
    }
    if (!functions->allocateMemory != !functions->freeMemory) {
        report(&none, fmi2Error, "allocateMemory and freeMemory must be given together");
        return NULL;
    }
    const size_t length = strlen(name) + 1;
    instance *m = allocate(functions, sizeof *m + length);
    if (!m) {
        report(&none, fmi2Error, "no memory for an instance");
        return NULL;
    }
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
    if (!sound(m, true)) return fmi2Error; /* parameters may be corrected and the call repeated */
    prepare(m);
    core_start(parameters(m), m->constants, &m->s.core);
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

/* -- FMU state ---------------------------------------------------------------- */

/* FNV-1a, 64 bit. */
static uint64_t checksum(const void *data, size_t size)
{
    const unsigned char *bytes = data;
    uint64_t hash = UINT64_C(14695981039346656037);
    for (size_t i = 0; i < size; ++i) hash = (hash ^ bytes[i]) * UINT64_C(1099511628211);
    return hash;
}

/* What a state must fulfil that did not come out of fmi2GetFMUstate itself: it may have been
 * stored, sent, or made up. Gives the reason if it does not. */
static const char *unsound(const instance *m, const model_state *s)
{
    const core_state *core = &s->core;
    if (s->phase != INSTANTIATED && s->phase != INITIALIZING && s->phase != RUNNING && s->phase != TERMINATED)
        return "unknown phase";
    if (!core_finite(s->start) || !core_finite(s->now) || s->now < 0.0) return "time";
    for (size_t i = 0; i < MODEL_INPUTS; ++i)
        if (!core_finite(s->rates[i])) return "input derivatives";
    for (size_t i = 0; i < MODEL_VARIABLES; ++i) {
        const double value = s->values[i];
        if (VARIABLE[i].kind != REAL
            && (!core_finite(value) || value != floor(value) || fabs(value) > (VARIABLE[i].kind == INTEGER ? INT32_MAX : 1)))
            return VARIABLE[i].name;
    }
    if (s->phase == INSTANTIATED || s->phase == INITIALIZING) return NULL; /* the core is made anew */
    instance probe = {.callbacks = m->callbacks, .name = m->name};
    probe.s = *s;
    if (!sound(&probe, false)) return "parameters";
    prepare(&probe);
    const core_schedule plan = core_scheduled(parameters(&probe), probe.constants);
    const double *numbers[] = {&core->integral, &core->counts, &core->measured, &core->limited, &core->active,
                               &core->plant.angle, &core->plant.speed, &core->plant.current, &core->plant.xi,
                               &core->tentative.angle, &core->tentative.speed, &core->tentative.current,
                               &core->tentative.xi};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; ++i)
        if (!core_finite(*numbers[i])) return "a number is not finite";
    for (size_t i = 0; i < core_line_length(&plan); ++i)
        if (!core_finite(core->line[i])) return "delay line";
    if (core->period < 0 || core->period > INT64_C(1000000000000) || core->position < 0
        || core->position >= plan.before + plan.after || (core->partial != 0 && core->partial != 1))
        return "place in time";
    if (core->partial) {
        const core_part *part = &core->part;
        const double *inputs[] = {&part->first.command, &part->first.aero_torque, &part->first.f_x,
                                  &part->first.f_z, &part->first.supply, &part->first.enable,
                                  &part->aero_torque, &part->f_x, &part->f_z, &part->origin, &part->covered};
        for (size_t i = 0; i < sizeof inputs / sizeof *inputs; ++i)
            if (!core_finite(*inputs[i])) return "part of a tick";
        const double h = core->position < (int32_t)plan.before ? plan.h_before : plan.h_after;
        if (part->origin < 0.0 || part->covered < part->origin || part->covered > h) return "part of a tick";
    }
    const double period = (double)core->period * plan.period;
    if (s->now < period - plan.slack || s->now > period + plan.period + plan.slack) return "place in time";
    return NULL;
}

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    instance *m = c;
    if (!allowed(m, ANY_PHASE, "fmi2GetFMUstate")) return fmi2Error;
    if (!state) return report(m, fmi2Error, "fmi2GetFMUstate: nowhere to put it");
    if (!*state) *state = allocate(&m->callbacks, sizeof(model_state));
    if (!*state) return report(m, fmi2Error, "fmi2GetFMUstate: no memory");
    memcpy(*state, &m->s, sizeof m->s);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state)
{
    instance *m = c;
    const model_state *s = state;
    if (!allowed(m, ANY_PHASE, "fmi2SetFMUstate")) return fmi2Error;
    if (!s) return report(m, fmi2Error, "fmi2SetFMUstate: no state given");
    if (memcmp(parameters(m), s->values + PARAMETER_BEGIN, MODEL_PARAMETERS * sizeof(double)) != 0) m->unprepared = 1;
    m->s = *s;
    m->force[0] = NAN;
    return fmi2OK;
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state)
{
    const instance *m = c;
    if (!m) return fmi2Error;
    if (state && *state) {
        release(&m->callbacks, *state);
        *state = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size)
{
    const instance *m = c;
    if (!allowed(m, ANY_PHASE, "fmi2SerializedFMUstateSize")) return fmi2Error;
    if (!state || !size) return report(m, fmi2Error, "fmi2SerializedFMUstateSize: argument missing");
    *size = sizeof(state_head) + sizeof(model_state);
    return fmi2OK;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size)
{
    const instance *m = c;
    if (!allowed(m, ANY_PHASE, "fmi2SerializeFMUstate")) return fmi2Error;
    if (!state || !bytes) return report(m, fmi2Error, "fmi2SerializeFMUstate: argument missing");
    if (size < sizeof(state_head) + sizeof(model_state))
        return report(m, fmi2Error, "fmi2SerializeFMUstate: %lu bytes are too few", (unsigned long)size);
    state_head head = {.magic = MODEL_GUID, .check = checksum(state, sizeof(model_state))};
    memcpy(bytes, &head, sizeof head);
    memcpy(bytes + sizeof head, state, sizeof(model_state));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state)
{
    const instance *m = c;
    state_head head;
    if (!allowed(m, ANY_PHASE, "fmi2DeSerializeFMUstate")) return fmi2Error;
    if (!bytes || !state) return report(m, fmi2Error, "fmi2DeSerializeFMUstate: argument missing");
    if (size != sizeof head + sizeof(model_state))
        return report(m, fmi2Error, "FMU state refused: it has %lu bytes, not %lu", (unsigned long)size,
                      (unsigned long)(sizeof head + sizeof(model_state)));
    memcpy(&head, bytes, sizeof head);
    if (strncmp(head.magic, MODEL_GUID, sizeof head.magic) != 0)
        return report(m, fmi2Error, "FMU state refused: it is of another FMU, not of %s", MODEL_GUID);
    if (head.check != checksum(bytes + sizeof head, sizeof(model_state)))
        return report(m, fmi2Error, "FMU state refused: its checksum is wrong");
    model_state s;
    memcpy(&s, bytes + sizeof head, sizeof s);
    s.fresh = 0;
    const char *reason = unsound(m, &s);
    if (reason) return report(m, fmi2Error, "FMU state refused: %s", reason);
    if (!*state) *state = allocate(&m->callbacks, sizeof s);
    if (!*state) return report(m, fmi2Error, "fmi2DeSerializeFMUstate: no memory");
    memcpy(*state, &s, sizeof s);
    return fmi2OK;
}
