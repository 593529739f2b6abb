/* An instance of the FMU: its data, log messages, checks of its parameters, and its outputs.
 *
 * Common to all versions of FMI. The including file defines the parts that depend on the version: FMI(name), the name
 * of a function or type in this version, host_services, log_message, allocate and release. interface.h is generated
 * from the interface: names, kinds, limits and start values of the variables; rules.h has the rules for parameters.
 */
#ifndef EMCAS_INSTANCE_H
#define EMCAS_INSTANCE_H

#include <float.h>
#include <stdarg.h>
#include <stdio.h>

#include "interface.h"
#include "multi_fin.h"
#include "parameter_checks.h"

/* HANDLING_EVENT is FMI 3.0's event mode. */
typedef enum { INSTANTIATED = 1, INITIALIZING = 2, RUNNING = 4, TERMINATED = 8, HANDLING_EVENT = 16 } phase;

enum {
    BEFORE_RUN = INSTANTIATED | INITIALIZING,
    DURING_RUN = RUNNING | HANDLING_EVENT,
    BEFORE_END = BEFORE_RUN | DURING_RUN,
    ANY_PHASE = BEFORE_END | TERMINATED,
    OUTPUT_BEGIN = FMU_INPUTS,
    PARAMETER_BEGIN = FMU_INPUTS + FMU_OUTPUTS,
    MESSAGE = 1024
};
CORE_REQUIRE(outputs_are_those_of_line_and_fins, (int)FMU_OUTPUTS == (int)MULTI_FIN_OUTPUTS);
CORE_REQUIRE(parameters_are_those_of_line_and_fins,
             (int)FIN_PARAMETER_BEGIN == (int)PARAMETER_BEGIN + (MULTI_FIN_LINE ? MODEL_LINE_PARAMETERS : 0));

/* Everything that reset renews and the FMU state functions copy. */
typedef struct {
    double values[FMU_VARIABLES];
    double tuned[FMU_TUNABLES + 1]; /* the tunable parameters to which the fins are bound; C has no empty arrays */
    double rates[FMU_INPUTS]; /* derivatives of the inputs in the next step (FMI 2.0) */
    double start, stop, now;    /* s; stop is infinite if the host sets none, now counts from the start */
    int32_t phase;
    int32_t has_rates;  /* a rate is set */
    int32_t terminated; /* the last step was discarded (FMI 2.0) */
    int32_t fresh;      /* the outputs in values are up to date */
    multi_fin_state fins;
} model_state;

typedef struct {
    host_services host;
    const char *name;
    uint32_t logged;    /* a bit for each category */
    int32_t pending;    /* the next step checks the parameters, and binds the fins to them */
    int32_t check_inputs; /* an input might be infinite or NaN */
    int32_t moved;      /* motion_loads are out of date */
    int32_t commanded;  /* check_drive has seen a command other than 0 */
    bool event_mode, early_return; /* the host uses event mode, allows early return (FMI 3.0) */
    bool ticks, interval_known; /* the clock ticks in this event; the host knows its interval (FMI 3.0) */
    multi_fin fins;
    double motion_loads[FINS][CORE_MOTION_LOADS]; /* of each fin */
    bool warned[FINS][RULES], warned_of_line[LINE_RULES + 1]; /* warnings that hold and are logged */
    model_state s;
} instance;

/* The head of a serialized state; a model_state follows. */
typedef struct {
    char magic[64]; /* MODEL_STATE identifies the interface and the code that wrote it */
    uint64_t check;
} state_head;

static const char *const CATEGORY[] = LOG_CATEGORIES;
enum {
    CATEGORIES = sizeof CATEGORY / sizeof *CATEGORY,
    LOG_ALL = CATEGORIES - 1,
    EVERY_CATEGORY = (1 << CATEGORIES) - 1
};

/* Log a message if logging of its category is on. Returns `status`, so that a refusal is one line. */
static int report(const instance *m, int status, const char *format, ...)
{
    const unsigned category = (unsigned)(status - FMI(Warning));
    if (m->logged & 1u << category) {
        char text[MESSAGE];
        va_list arguments;
        va_start(arguments, format);
        vsnprintf(text, sizeof text, format, arguments);
        va_end(arguments);
        log_message(&m->host, m->name, status, CATEGORY[category], text);
    }
    return status;
}

static const char *phase_name(int32_t at)
{
    return at == INSTANTIATED   ? "instantiated"
         : at == INITIALIZING   ? "initializing"
         : at == RUNNING        ? "running"
         : at == HANDLING_EVENT ? "in event mode"
                                : "terminated";
}

/* Return whether a function may be called in the current phase; log an error if not. */
static bool allowed(const instance *m, int phases, const char *function)
{
    if (!m) return false;
    if (m->s.phase & phases) return true;
    report(m, FMI(Error), "%s called while %s", function, phase_name(m->s.phase));
    return false;
}

/* Return whether a function may be called now with two pointers to `n` elements; log an error if not. */
static bool allowed_with(const instance *m, int phases, size_t n, const void *first, const void *second,
                         const char *function)
{
    if (!allowed(m, phases, function)) return false;
    if (n == 0 || (first && second)) return true;
    report(m, FMI(Error), "%s: an argument is missing", function);
    return false;
}

/* Define a function that the FMU does not support: an error, unless its `count` of variables is 0. */
#define UNSUPPORTED(Name, phases, count, reason, parameters)                                       \
    FMI(Status) FMI(Name) parameters                                                               \
    {                                                                                              \
        if (!allowed(c, phases, __func__)) return FMI(Error);                                    \
        return (count) ? report(c, FMI(Error), "%s: %s", __func__, reason) : FMI(OK);          \
    }

/* Switch logging of `n` categories on or off; of all categories if `n` is 0. */
FMI(Status) FMI(SetDebugLogging)(void *c, FMI(Boolean) on, size_t n, const FMI(String) categories[])
{
    instance *m = c;
    uint32_t chosen = n ? 0 : EVERY_CATEGORY;
    if (!allowed_with(m, ANY_PHASE, n, categories, categories, __func__)) return FMI(Error);
    for (size_t i = 0; i < n; ++i) {
        unsigned k = 0;
        while (k < CATEGORIES && (!categories[i] || strcmp(categories[i], CATEGORY[k]) != 0)) ++k;
        if (k == CATEGORIES)
            return report(m, FMI(Error), "there is no log category %s", categories[i] ? categories[i] : "(null)");
        chosen |= k == LOG_ALL ? EVERY_CATEGORY : 1u << k;
    }
    m->logged = on ? chosen : m->logged & ~chosen;
    return FMI(OK);
}

static const double *parameters(const instance *m, size_t fin)
{
    return m->s.values + FIN_PARAMETER_BEGIN + fin * MODEL_PARAMETERS;
}

/* Return whether a value is outside its variable's limits; log an error if so. */
static bool out_of_range(const instance *m, size_t vr, double value)
{
    const variable *v = &VARIABLE[vr];
    if (!core_finite(value))
        report(m, FMI(Error), NOT_FINITE, v->name, value);
    else if (value < v->minimum)
        report(m, FMI(Error), BELOW, v->name, value, v->minimum);
    else if (value > v->maximum)
        report(m, FMI(Error), ABOVE, v->name, value, v->maximum);
    else
        return false;
    return true;
}

/* Log the message of a rule, a format with at most RULE_NUMBERS numbers `n`. */
static void report_rule(const instance *m, int status, size_t fin, const char *message, const double *n)
{
    char format[MESSAGE] = "";
    if (FINS > 1 && fin < FINS) snprintf(format, sizeof format, OF_FIN, (unsigned)fin + 1);
    strncat(format, message, sizeof format - strlen(format) - 1);
    report(m, status, format, n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7], n[8], n[9], n[10], n[11]);
}

/* Return whether the parameters `p` of a fin (of the line if `fin` is FINS) keep the rules that warn, if `status` is
 * that of a warning, or the rules that refuse. Log every broken rule with the status, but a warning only once while it
 * holds; `warned` stores that. */
static bool rules_kept(const instance *m, int status, const rule *some, size_t count, const double *p,
                       const double *constants, size_t fin, bool *warned)
{
    const bool warnings = status == FMI(Warning);
    double numbers[RULE_NUMBERS + 1];
    bool good = true;
    for (size_t i = 0; i < count; ++i) {
        if ((bool)some[i].warning != warnings) continue;
        const bool broken = rules_broken(&some[i], p, constants, numbers);
        if (broken && !warned[i]) report_rule(m, status, fin, some[i].message, numbers + 1);
        warned[i] = broken && warnings;
        good &= !broken;
    }
    return good;
}

static bool all_rules_kept(instance *m, int status)
{
    double constants[RULES_CONSTANTS];
    bool good = true;
#if LINE_RULES
    const double *line = m->s.values + PARAMETER_BEGIN;
    double of_line[LINE_RULES_CONSTANTS + 1];
    line_rules_prepare(line, of_line);
    good &= rules_kept(m, status, LINE_RULE, LINE_RULES, line, of_line, FINS, m->warned_of_line);
#endif
    for (size_t fin = 0; fin < FINS; ++fin) {
        rules_prepare(parameters(m, fin), constants);
        good &= rules_kept(m, status, RULE, RULES, parameters(m, fin), constants, fin, m->warned[fin]);
    }
    return good;
}

/* Return whether all parameters are within their limits and keep the rules; log every value outside its limits, or, if
 * all are within, every broken rule with the status. */
static bool sound(instance *m, int status)
{
    bool good = true;
    for (size_t vr = 0; vr < FMU_VARIABLES; ++vr)
        if (vr >= PARAMETER_BEGIN || VARIABLE[vr].tunable) good &= !out_of_range(m, vr, m->s.values[vr]);
    return good && all_rules_kept(m, status);
}

static bool sound_unlogged(instance *m)
{
    const uint32_t logged = m->logged;
    m->logged = 0;
    const bool good = sound(m, FMI(Error));
    m->logged = logged;
    return good;
}

/* Bind the fins to the parameters, which must be sound. */
static void prepare(instance *m)
{
    double *tuned = m->s.tuned;
    for (size_t i = PARAMETER_BEGIN; i < FMU_VARIABLES; ++i)
        if (VARIABLE[i].tunable) *tuned++ = m->s.values[i];
    multi_fin_bind(&m->fins, m->s.values + PARAMETER_BEGIN, parameters(m, 0)); /* the line's come first */
    m->pending = 0;
    m->moved = 1; /* motion loads depend on parameters, too */
}

/* Compute the inputs of a fin's core from the FMU's inputs `values`. */
static void acting(const instance *m, size_t fin, const double *values, const double *motion_loads, core_inputs *out)
{
#if FINS == 1
    const double *in = values; /* a single fin's inputs are those of the FMU */
#else
    double in[MODEL_INPUTS];
    for (size_t i = 0; i < MODEL_INPUTS; ++i) in[i] = values[INPUT_INDEX[fin][i]];
#endif
    multi_fin_acting(&m->fins, fin, in, values + MIXING_BEGIN, motion_loads, out);
}

static void acting_now(const instance *m, core_inputs *in)
{
    for (size_t fin = 0; fin < FINS; ++fin) acting(m, fin, m->s.values, m->motion_loads[fin], &in[fin]);
}

static void update_motion_loads(const instance *m, const double *values, double (*out)[CORE_MOTION_LOADS])
{
    for (size_t fin = 0; fin < FINS; ++fin)
        core_motion_loads(m->fins.p[fin], m->fins.c[fin], values + MOTION_BEGIN, out[fin]);
}

static void update_motion_loads_now(instance *m)
{
    update_motion_loads(m, m->s.values, m->motion_loads);
    m->moved = 0;
}

/* Update the outputs. They cannot be computed if an input is not finite or parameters break a limit or rule, for which
 * the next step is refused: during the run they are then unchanged, before it they are NaN, 0 or false. */
static void refresh(instance *m)
{
    const bool before = m->s.phase & BEFORE_RUN;
    core_inputs now[FINS];
    m->s.fresh = 1;
    const bool possible = core_all_finite(m->s.values, FMU_INPUTS) && (!m->pending || sound_unlogged(m));
    if (!possible && !before) return;
    if (!possible) {
        for (size_t vr = OUTPUT_BEGIN; vr < PARAMETER_BEGIN; ++vr)
            m->s.values[vr] = VARIABLE[vr].kind == REAL ? NAN : 0.0;
        return;
    }
    if (m->pending) {
        prepare(m);
        m->pending = 1; /* the next step logs warnings */
    }
    if (before) multi_fin_start(&m->fins, &m->s.fins);
    update_motion_loads_now(m);
    acting_now(m, now);
    multi_fin_outputs(&m->fins, &m->s.fins, now, m->s.values + OUTPUT_BEGIN);
}

/* Return whether a variable may be set; log an error if not. Infinite or NaN inputs are refused by the next step. */
static bool settable(const instance *m, size_t index, double value)
{
    if (index >= OUTPUT_BEGIN && index < PARAMETER_BEGIN)
        report(m, FMI(Error), "%s is an output and cannot be set", VARIABLE[index].name);
    else if ((index < OUTPUT_BEGIN && !VARIABLE[index].tunable) || (m->s.phase & BEFORE_RUN))
        return true;
    else if (!VARIABLE[index].tunable)
        report(m, FMI(Error), "%s is fixed and cannot be set after initialization", VARIABLE[index].name);
    else
        return !out_of_range(m, index, value);
    return false;
}

static void set_one(instance *m, size_t index, double value)
{
    m->s.values[index] = value;
    m->s.fresh = 0;
    if (!core_finite(value)) m->check_inputs = 1;
    if (index >= PARAMETER_BEGIN) m->pending = 1;
    if (index - MOTION_BEGIN < MODEL_MOTION) m->moved = 1; /* unsigned: smaller indices wrap around */
}

#endif
