/* An instance: what it holds, what it tells, whether its parameters make sense, its outputs.
 *
 * interface.h is generated from the variable table: names, kinds, limits, start values,
 * rules for parameter sets.
 */
#ifndef EMCAS_INSTANCE_H
#define EMCAS_INSTANCE_H

#include <float.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#include "fmi2Functions.h"

#include "core.h"
#include "interface.h"
#include "parameter_checks.h"

typedef enum { INSTANTIATED = 1, INITIALIZING = 2, RUNNING = 4, TERMINATED = 8 } phase;

enum {
    ANY_PHASE = INSTANTIATED | INITIALIZING | RUNNING | TERMINATED,
    OUTPUT_BEGIN = UNIT_INPUTS,
    PARAMETER_BEGIN = UNIT_INPUTS + UNIT_OUTPUTS,
    MESSAGE = 1024
};

/* All that reset and the FMU state functions copy. */
typedef struct {
    double values[UNIT_VARIABLES];
    double rates[UNIT_INPUTS]; /* of the inputs, for the next step */
    double start, now;          /* now counts from the start */
    int32_t phase;
    int32_t rated;      /* some rate was given */
    int32_t terminated; /* the last step could not be followed */
    int32_t fresh;      /* the outputs in values are those of now */
    core_state core[FINS];
#if FINS > 1
    double sag;      /* of the bus */
    int64_t instant; /* of the bus, that comes next */
#endif
} model_state;

/* Of a fin, what follows from parameters and inputs. */
typedef struct {
    double force[2], constants[KERNEL_CONSTANTS];
} prepared;

typedef struct {
    fmi2CallbackFunctions callbacks;
    fmi2String name;
    uint32_t logged;    /* a bit for each category */
    int32_t unprepared; /* constants are not those of the parameters */
    int32_t unforced;   /* forces are not those of the inputs */
    double slack;
    prepared fin[FINS];
    model_state s;
} instance;

/* Serialized: this before a model_state. */
typedef struct {
    char magic[64]; /* MODEL_STATE: the interface and the code that wrote it */
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

/* -- parameters --------------------------------------------------------------- */

static const double *parameters(const instance *m, size_t fin)
{
    return m->s.values + FIN_PARAMETER_BEGIN + fin * MODEL_PARAMETERS;
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
static void tell(const instance *m, size_t fin, const char *message, const double *n)
{
    char format[MESSAGE] = "";
    if (FINS > 1) snprintf(format, sizeof format, "fin[%u]: ", (unsigned)fin + 1);
    strncat(format, message, sizeof format - strlen(format) - 1);
    report(m, fmi2Error, format, n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11]);
}

/* Whether the parameters are sets to compute with. */
static bool all_rules_hold(const instance *m)
{
    for (size_t vr = PARAMETER_BEGIN; vr < FIN_PARAMETER_BEGIN; ++vr) /* those of no fin */
        if (!core_finite(m->s.values[vr]) || m->s.values[vr] < VARIABLE[vr].minimum
            || m->s.values[vr] > VARIABLE[vr].maximum)
            return false;
    for (size_t fin = 0; fin < FINS; ++fin)
        if (!rules_hold(parameters(m, fin))) return false;
    return true;
}

/* The same; every problem is told: of single values, or if there is none, of their combination. */
static bool sound(const instance *m)
{
    double constants[RULES_CONSTANTS], numbers[RULE_NUMBERS + 1];
    bool good = true;
    if (all_rules_hold(m)) return true;
    for (size_t vr = PARAMETER_BEGIN; vr < UNIT_VARIABLES; ++vr)
        good &= !out_of_range(m, fmi2Error, vr, m->s.values[vr]);
    if (!good) return false;
    for (size_t fin = 0; fin < FINS; ++fin) {
        rules_prepare(parameters(m, fin), constants);
        for (size_t i = 0; i < RULES; ++i)
            if (rules_broken(&RULE[i], parameters(m, fin), constants, numbers))
                tell(m, fin, RULE[i].message, numbers + 1);
    }
    return false;
}

static void prepare(instance *m)
{
    m->slack = HUGE_VAL;
    for (size_t fin = 0; fin < FINS; ++fin) {
        const double *p = parameters(m, fin);
        kernel_prepare(p, m->fin[fin].constants);
        m->slack = fmin(m->slack, core_scheduled(p, m->fin[fin].constants).slack);
    }
    m->unprepared = 0;
    m->unforced = 1; /* they depend on parameters too */
}

/* -- inputs and outputs ------------------------------------------------------- */

static bool finite_inputs(const double *in)
{
    bool good = true;
    for (size_t i = 0; i < UNIT_INPUTS; ++i) good &= core_finite(in[i]);
    return good;
}

static void fin_outputs(const instance *m, size_t fin, const core_state *core, const core_inputs *in, double *out)
{
    const double *p = parameters(m, fin), *c = m->fin[fin].constants;
    const core_schedule plan = core_scheduled(p, c);
    core_outputs(p, c, core, core_line_length(&plan), in, out);
}

#if FINS == 1

/* A single fin's inputs are the unit's. */
static const double *inputs_of(const double *values, size_t fin, double *room)
{
    (void)fin, (void)room;
    return values;
}

static core_inputs acting(const instance *m, size_t fin, const double *in, const double *force)
{
    (void)m, (void)fin;
    return core_inputs_of(in[INPUT_FIN_COMMAND], in, force);
}

static core_result unit_run(instance *m, double end, const core_inputs *in, const core_ramp *ramp)
{
    return core_run(parameters(m, 0), m->fin[0].constants, m->s.core, end, in, ramp, m->s.values + FIN_OUTPUT_BEGIN);
}

static void start_bus(instance *m)
{
    (void)m;
}

static void find_outputs(instance *m, const core_inputs *in)
{
    fin_outputs(m, 0, m->s.core, in, m->s.values + FIN_OUTPUT_BEGIN);
}

static const char *unsound_bus(const model_state *s)
{
    (void)s;
    return NULL;
}

#else
#include "multi_fin.h"
#endif

static void forces(const instance *m, size_t fin, const double *values, double *out)
{
    double room[MODEL_INPUTS];
    const double *in = inputs_of(values, fin, room);
    kernel_forces(parameters(m, fin), m->fin[fin].constants, in[INPUT_ACCELERATION_X], in[INPUT_ACCELERATION_Y],
                  in[INPUT_ACCELERATION_Z], in[INPUT_ATTITUDE_ROLL], in[INPUT_ATTITUDE_PITCH], out);
}

static void find_forces(instance *m)
{
    for (size_t fin = 0; fin < FINS; ++fin) forces(m, fin, m->s.values, m->fin[fin].force);
    m->unforced = 0;
}

static void start_cores(instance *m)
{
    for (size_t fin = 0; fin < FINS; ++fin) core_start(parameters(m, fin), m->fin[fin].constants, &m->s.core[fin]);
    start_bus(m);
}

/* Bring the outputs up to now. Inputs that the next step will refuse change no output. */
static void refresh(instance *m)
{
    const bool before = m->s.phase & (INSTANTIATED | INITIALIZING);
    core_inputs now[FINS];
    m->s.fresh = 1;
    if (!finite_inputs(m->s.values)) return;
    if (before && !all_rules_hold(m)) {
        for (size_t vr = OUTPUT_BEGIN; vr < PARAMETER_BEGIN; ++vr)
            m->s.values[vr] = VARIABLE[vr].kind == REAL ? NAN : 0.0;
        return;
    }
    if (before || m->unprepared) prepare(m);
    if (before) start_cores(m);
    find_forces(m);
    for (size_t fin = 0; fin < FINS; ++fin) now[fin] = acting(m, fin, m->s.values, m->fin[fin].force);
    find_outputs(m, now);
}

#endif
