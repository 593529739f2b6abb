/* An instance: what it holds, what it reports, whether its parameters make sense, its outputs.
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

#include "interface.h"
#include "multi_fin.h"
#include "parameter_checks.h"

typedef enum { INSTANTIATED = 1, INITIALIZING = 2, RUNNING = 4, TERMINATED = 8 } phase;

enum {
    ANY_PHASE = INSTANTIATED | INITIALIZING | RUNNING | TERMINATED,
    OUTPUT_BEGIN = UNIT_INPUTS,
    PARAMETER_BEGIN = UNIT_INPUTS + UNIT_OUTPUTS,
    MESSAGE = 1024
};
_Static_assert((int)UNIT_OUTPUTS == (int)MULTI_FIN_OUTPUTS, "a unit's outputs are those of the line and of the fins");
_Static_assert((int)FIN_PARAMETER_BEGIN == (int)PARAMETER_BEGIN + (MULTI_FIN_LINE ? MODEL_LINE_PARAMETERS : 0),
               "a unit's parameters are those of the line and of the fins");

/* All that reset and the FMU state functions copy. */
typedef struct {
    double values[UNIT_VARIABLES];
    double rates[UNIT_INPUTS]; /* of the inputs, for the next step */
    double start, now;          /* now counts from the start */
    int32_t phase;
    int32_t rated;      /* some rate was given */
    int32_t terminated; /* the last step could not be followed */
    int32_t fresh;      /* the outputs in values are those of now */
    multi_fin_state fins;
} model_state;

typedef struct {
    fmi2CallbackFunctions callbacks;
    fmi2String name;
    uint32_t logged;    /* a bit for each category */
    int32_t unprepared; /* fins are not bound to the parameters */
    int32_t check_inputs; /* one may not be finite */
    int32_t moved;      /* what the vehicle's motion makes is not that of the inputs */
    multi_fin fins;
    double carried[FINS][CORE_CARRIED]; /* what the vehicle's motion makes of each fin */
    bool warned[FINS][RULES]; /* which warnings the log has */
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

/* Whether a value is outside its variable's limits, with a report. */
static bool out_of_range(const instance *m, size_t vr, double value)
{
    const variable *v = &VARIABLE[vr];
    if (!core_finite(value))
        report(m, fmi2Error, NOT_FINITE, v->name, value);
    else if (value < v->minimum)
        report(m, fmi2Error, BELOW, v->name, value, v->minimum);
    else if (value > v->maximum)
        report(m, fmi2Error, ABOVE, v->name, value, v->maximum);
    else
        return false;
    return true;
}

/* A rule's message: a format of no more than RULE_NUMBERS numbers, the rest is not looked at. */
static void report_rule(const instance *m, fmi2Status status, size_t fin, const char *message, const double *n)
{
    char format[MESSAGE] = "";
    if (FINS > 1) snprintf(format, sizeof format, "fin[%u]: ", (unsigned)fin + 1);
    strncat(format, message, sizeof format - strlen(format) - 1);
    report(m, status, format, n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11]);
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

/* The same, with a report of every problem: of single values, or if there is none, of their combination. */
static bool sound(const instance *m)
{
    double constants[RULES_CONSTANTS], numbers[RULE_NUMBERS + 1];
    bool good = true;
    if (all_rules_hold(m)) return true;
    for (size_t vr = PARAMETER_BEGIN; vr < UNIT_VARIABLES; ++vr)
        good &= !out_of_range(m, vr, m->s.values[vr]);
    if (!good) return false;
    for (size_t fin = 0; fin < FINS; ++fin) {
        rules_prepare(parameters(m, fin), constants);
        for (size_t i = 0; i < RULES; ++i)
            if (!RULE[i].warning && rules_broken(&RULE[i], parameters(m, fin), constants, numbers))
                report_rule(m, fmi2Error, fin, RULE[i].message, numbers + 1);
    }
    return false;
}

/* Log the warnings about the parameters, each once until it no longer holds; the status of the call stays fmi2OK. */
static void warn(instance *m)
{
    double constants[RULES_CONSTANTS], numbers[RULE_NUMBERS + 1];
    for (size_t fin = 0; fin < FINS; ++fin) {
        rules_prepare(parameters(m, fin), constants);
        for (size_t i = 0; i < RULES; ++i) {
            if (!RULE[i].warning) continue;
            const bool broken = rules_broken(&RULE[i], parameters(m, fin), constants, numbers);
            if (broken && !m->warned[fin][i]) report_rule(m, fmi2Warning, fin, RULE[i].message, numbers + 1);
            m->warned[fin][i] = broken;
        }
    }
}

static void prepare(instance *m)
{
    multi_fin_bind(&m->fins, m->s.values + PARAMETER_BEGIN, parameters(m, 0)); /* the line's come first */
    m->unprepared = 0;
    m->moved = 1; /* it depends on parameters too */
}

/* -- inputs and outputs ------------------------------------------------------- */

/* What acts on a fin by the unit's inputs `values`. */
static void acting(const instance *m, size_t fin, const double *values, const double *carried, core_inputs *out)
{
#if FINS == 1
    const double *in = values; /* a single fin's inputs are the unit's */
#else
    double in[MODEL_INPUTS];
    for (size_t i = 0; i < MODEL_INPUTS; ++i) in[i] = values[PLACE[fin][i]];
#endif
    multi_fin_acting(&m->fins, fin, in, values + MIXING_BEGIN, carried, out);
}

static void acting_now(const instance *m, core_inputs *in)
{
    for (size_t fin = 0; fin < FINS; ++fin) acting(m, fin, m->s.values, m->carried[fin], &in[fin]);
}

static void carry(const instance *m, const double *values, double (*out)[CORE_CARRIED])
{
    for (size_t fin = 0; fin < FINS; ++fin)
        core_carried(m->fins.p[fin], m->fins.c[fin], values + MOTION_BEGIN, out[fin]);
}

static void carry_now(instance *m)
{
    carry(m, m->s.values, m->carried);
    m->moved = 0;
}

/* Bring the outputs up to now. Inputs that the next step will refuse change no output. */
static void refresh(instance *m)
{
    const bool before = m->s.phase & (INSTANTIATED | INITIALIZING);
    core_inputs now[FINS];
    m->s.fresh = 1;
    if (!core_all_finite(m->s.values, UNIT_INPUTS)) return;
    if (before && !all_rules_hold(m)) {
        for (size_t vr = OUTPUT_BEGIN; vr < PARAMETER_BEGIN; ++vr)
            m->s.values[vr] = VARIABLE[vr].kind == REAL ? NAN : 0.0;
        return;
    }
    if (before || m->unprepared) prepare(m);
    if (before) multi_fin_start(&m->fins, &m->s.fins);
    carry_now(m);
    acting_now(m, now);
    multi_fin_outputs(&m->fins, &m->s.fins, now, m->s.values + OUTPUT_BEGIN);
}

#endif
