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
#include "sound.h"

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

/* Whether the parameters are a set to compute with; every problem is told: of single values, or if
 * there is none, of their combination. */
static bool sound(const instance *m)
{
    const double *p = parameters(m);
    double constants[RULES_CONSTANTS], numbers[RULE_NUMBERS + 1];
    bool good = true;
    if (rules_hold(p)) return true;
    for (size_t vr = PARAMETER_BEGIN; vr < MODEL_VARIABLES; ++vr)
        good &= !out_of_range(m, fmi2Error, vr, m->s.values[vr]);
    if (!good) return false;
    rules_prepare(p, constants);
    for (size_t i = 0; i < RULES; ++i)
        if (rules_broken(&RULE[i], p, constants, numbers)) tell(m, RULE[i].message, numbers + 1);
    return false;
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
    if (before && !rules_hold(parameters(m))) {
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

#endif
