/* FINS fins that share one supply line: multi_fin.py in C.
 *
 * `multi_fin_x` and `line_x` are the method x or _x of MultiFin, run_fins its _run_fins. states.h checks stored states
 * as MultiFin.unsound does.
 *
 * The line is stiff if the first of its parameters is 0; each fin then runs as it would alone. A single fin, and fins
 * without a supply, always run alone. Otherwise every fin ends a step at each instant of the line: each multiple of
 * its update time, the last parameter. There its state is updated from the fins' consumption; in between it is held.
 */
#ifndef EMCAS_MULTI_FIN_H
#define EMCAS_MULTI_FIN_H

#include "core.h"

#define MULTI_FIN_LINE (FINS > 1 && MODEL_SUPPLY >= 0)

/* The outputs of the line precede those of the fins: the level (voltage or pressure) at the fins, their consumption
 * (current or flow) and their power. */
enum { LINE_OUTPUTS = MULTI_FIN_LINE ? 3 : 0, MULTI_FIN_OUTPUTS = LINE_OUTPUTS + FINS * MODEL_OUTPUTS };

/* Parameters of the line and of each fin, and the constants computed from these; the tolerance of communication points
 * and the latest start on a host's clock [s]. */
typedef struct {
    const double *line, *p[FINS];
    double c[FINS][KERNEL_CONSTANTS];
    double slack, latest;
} multi_fin;

/* Everything that changes while running: the fins; the line's states; the mean consumption of the fins in the last
 * interval; for fins that store charge, the charge that each fin had consumed by then, and its mean power [W]; and the
 * number of the next instant. */
typedef struct {
    core_state core[FINS];
    double line[MODEL_LINE_STATES];
#if MULTI_FIN_LINE
    double mean, charge[FINS], power[FINS];
#endif
    int64_t instant;
} multi_fin_state;

/* Return the lesser number; some hosts do not have fmin. */
static double lesser(double a, double b)
{
    return a < b ? a : b;
}

/* Set the parameters of the `line`, and `p` of the fins, one fin after the other. */
static void multi_fin_bind(multi_fin *m, const double *line, const double *p)
{
    m->line = line;
    m->slack = m->latest = HUGE_VAL;
    for (size_t fin = 0; fin < FINS; ++fin) {
        m->p[fin] = p + fin * MODEL_PARAMETERS;
        kernel_prepare(m->p[fin], m->c[fin]);
        const core_schedule plan = core_scheduled(m->p[fin], m->c[fin]);
        m->slack = lesser(m->slack, plan.slack);
        m->latest = lesser(m->latest, CORE_LATEST * lesser(plan.h_before, plan.h_after));
    }
}

static void multi_fin_start(const multi_fin *m, multi_fin_state *s)
{
    *s = (multi_fin_state){.instant = 1};
#if MULTI_FIN_LINE
    kernel_line_start(m->p[0], m->c[0] MODEL_LINE_OF(m->line), s->line);
#endif
    for (size_t fin = 0; fin < FINS; ++fin) core_start(m->p[fin], m->c[fin], &s->core[fin]);
}

#if MULTI_FIN_LINE
static bool multi_fin_stiff(const multi_fin *m)
{
    return !(m->line[0] > 0.0);
}

static double multi_fin_interval(const multi_fin *m)
{
    return m->line[MODEL_LINE_PARAMETERS - 1];
}
#endif

/* Compute a fin's core inputs, with the source as supply, from its actuator's inputs, the mixing commands and its
 * motion loads. The result is linear in these. */
static void multi_fin_acting(const multi_fin *m, size_t fin, const double *in, const double *mixing,
                             const double *motion_loads, core_inputs *out)
{
    core_inputs_of(in, motion_loads, out);
#if FINS > 1
    kernel_mixed_command(m->p[fin], m->c[fin], in[INPUT_FIN_COMMAND], mixing[0], mixing[1], mixing[2],
                         &out->command);
#else
    (void)m, (void)fin, (void)mixing;
#endif
}

/* Return the level at the fins with this source and these states of the line. */
static double line_level(const multi_fin *m, double source, const double *states)
{
    double level = source;
#if MULTI_FIN_LINE
    kernel_line_level(m->p[0], m->c[0], source MODEL_LINE_STATES_OF(states), &level);
#else
    (void)m, (void)states;
#endif
    return level;
}

/* Compute the outputs of the line from the outputs of the fins, which follow them in `out`. */
static void line_shared(const multi_fin *m, double source, const double *states, double *out)
{
#if MULTI_FIN_LINE
    out[0] = line_level(m, source, states);
    out[2] = 0.0;
    for (size_t fin = 0; fin < FINS; ++fin) out[2] += out[LINE_OUTPUTS + fin * MODEL_OUTPUTS + MODEL_SUPPLY_POWER];
    kernel_line_drawn(m->p[0], m->c[0], out[2], out[0], &out[1]);
#else
    (void)m, (void)source, (void)states, (void)out;
#endif
}

/* Compute the outputs of the line at a communication point. Current and powers of fins that store charge are means over
 * the last interval, unless the line is stiff. */
static void line_all_outputs(const multi_fin *m, const multi_fin_state *s, double source, double *out)
{
#if MULTI_FIN_LINE && defined MODEL_CHARGED
    const bool averaged = !multi_fin_stiff(m);
    for (size_t fin = 0; averaged && fin < FINS; ++fin)
        out[LINE_OUTPUTS + fin * MODEL_OUTPUTS + MODEL_SUPPLY_POWER] = s->power[fin];
    line_shared(m, source, s->line, out);
    if (averaged) out[1] = s->mean;
#else
    line_shared(m, source, s->line, out);
#endif
}

static void multi_fin_outputs(const multi_fin *m, const multi_fin_state *s, const core_inputs *in, double *out)
{
    for (size_t fin = 0; fin < FINS; ++fin) {
        const core_schedule plan = core_scheduled(m->p[fin], m->c[fin]);
        core_inputs acting = in[fin];
        acting.supply = line_level(m, acting.supply, s->line);
        core_outputs(m->p[fin], m->c[fin], EVERY_LANE, &s->core[fin], &s->core[fin].tentative, &plan, &acting,
                     out + LINE_OUTPUTS + fin * MODEL_OUTPUTS);
    }
    line_all_outputs(m, s, in->supply, out);
}

#if FINS == 1

/* Advance to `end` [s] from the start, all or nothing; the outputs there are written to `out`. core_run restores the
 * state itself, and copies only the used part of the delay buffer. */
static core_result multi_fin_run(const multi_fin *m, multi_fin_state *state, double from, double end,
                                 const core_inputs *in, const core_ramp *ramp, double *out)
{
    double outputs[MODEL_OUTPUTS];
    (void)from;
    const core_result result = core_run(m->p[0], m->c[0], state->core, end, in, ramp, outputs);
    if (result == CORE_DONE) memcpy(out, outputs, sizeof outputs);
    return result;
}

#else

static double source_at(const core_inputs *in, const core_ramp *ramp, double time)
{
    return in->supply + (ramp ? ramp->supply * (time - ramp->begin) : 0.0);
}

/* Advance all fins to `until` [s]. The level follows a ramp of the source if it is the source's less the sag at both
 * ends; otherwise the level at the source's mean is held. */
static core_result run_fins(const multi_fin *m, multi_fin_state *s, double from, double until, const core_inputs *in,
                            const core_ramp *ramp, double *out)
{
    const double *states = s->line, sag = MODEL_LINE_SAGS ? states[0] : 0.0;
    for (size_t fin = 0; fin < FINS; ++fin) {
        core_inputs acting = in[fin];
        core_ramp rising;
        acting.supply = line_level(m, acting.supply, states);
        if (ramp) {
            const double first = source_at(&in[fin], &ramp[fin], from), last = source_at(&in[fin], &ramp[fin], until);
            rising = ramp[fin];
            acting.supply = in[fin].supply - sag;
            if (line_level(m, first, states) != first - sag || line_level(m, last, states) != last - sag) {
                acting.supply = line_level(m, 0.5 * (first + last), states);
                rising.supply = 0.0;
            }
        }
        const core_result result = core_run(m->p[fin], m->c[fin], &s->core[fin], until, &acting,
                                            ramp ? &rising : NULL, out + LINE_OUTPUTS + fin * MODEL_OUTPUTS);
        if (result != CORE_DONE) return result;
    }
    return CORE_DONE;
}

#if MULTI_FIN_LINE
/* Return the consumption of the fins from now on, computed from their outputs; store its mean since the last instant,
 * and the charges and mean powers of fins that store charge. */
static double line_consumed_next(const multi_fin *m, multi_fin_state *s, double source, double *out)
{
    line_shared(m, source, s->line, out);
    s->mean = out[1];
#ifdef MODEL_CHARGED
    double consumption = 0.0;
    const double interval = multi_fin_interval(m);
    s->mean = 0.0;
    for (size_t fin = 0; fin < FINS; ++fin) {
        double current, course[2];
        const core_plant *x = &s->core[fin].tentative;
        kernel_line_drawn(m->p[fin], m->c[fin], out[LINE_OUTPUTS + fin * MODEL_OUTPUTS + MODEL_SUPPLY_POWER], out[0],
                          &current);
        kernel_line_course(m->p[fin], m->c[fin], interval, current, s->charge[fin], CORE_PLANT_OF(x), course);
        const double mean = (course[0] - s->charge[fin]) / interval;
        consumption += course[1];
        s->mean += mean;
        s->charge[fin] = course[0];
        s->power[fin] = out[0] * mean;
    }
    return consumption;
#else
    return out[1];
#endif
}

/* Compute the line's `next` states after an instant from which the fins consume `consumption`. */
static void line_following(const multi_fin *m, const multi_fin_state *s, double source, double consumption,
                           double *next)
{
    double total = 0.0; /* of the inverse inductances */
    for (size_t fin = 0; fin < FINS; ++fin) {
        double inverse;
        kernel_inverse_inductance(m->p[fin], m->c[fin], multi_fin_interval(m), &inverse);
        total += inverse;
    }
    kernel_line_following(m->p[0], m->c[0] MODEL_LINE_OF(m->line), source MODEL_LINE_STATES_OF(s->line),
                          consumption, s->mean, total, next);
}
#endif

/* Advance from `from` to `end` [s from the start], all or nothing; the outputs there are written to `out`. */
static core_result multi_fin_run(const multi_fin *m, multi_fin_state *state, double from, double end,
                                 const core_inputs *in, const core_ramp *ramp, double *out)
{
    multi_fin_state s = *state;
    double outputs[MULTI_FIN_OUTPUTS];
#if MULTI_FIN_LINE
    const bool stiff = multi_fin_stiff(m);
    const double interval = multi_fin_interval(m);
    if (!stiff && !(end / interval - (double)s.instant <= CORE_MOST_TICKS)) return CORE_TOO_MANY_TICKS;
    /* By rounding, a host's time may be slightly before an instant at which its step ends. */
    for (double next; !stiff && (next = (double)s.instant * interval) <= end + m->slack; ++s.instant) {
        const double until = next < end ? next : end;
        const core_result reached = run_fins(m, &s, from, until, in, ramp, outputs);
        if (reached != CORE_DONE) return reached;
        const double source = source_at(in, ramp, until), consumption = line_consumed_next(m, &s, source, outputs);
        double following[MODEL_LINE_STATES];
        line_following(m, &s, source, consumption, following);
        if (!core_all_finite(following, MODEL_LINE_STATES)) return CORE_NOT_FINITE;
        memcpy(s.line, following, sizeof following);
        from = until;
    }
#endif
    const core_result result = run_fins(m, &s, from, end, in, ramp, outputs);
    if (result != CORE_DONE) return result;
    line_all_outputs(m, &s, source_at(in, ramp, end), outputs);
    *state = s;
    memcpy(out, outputs, sizeof outputs);
    return CORE_DONE;
}

#endif

#endif
