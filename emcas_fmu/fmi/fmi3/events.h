/* Steps that end at events: a discrete output changes, or a fin sticks or comes loose. A part of fmi3.c.
 *
 * An event is looked for at the ends of ticks and then between them, by steps from copies of the state, to within the
 * tolerance of communication points. The trajectory is that of one long step, since it does not depend on where these
 * are. What begins and ends within one tick is not seen.
 */
#ifndef EMCAS_EVENTS_H
#define EMCAS_EVENTS_H

#include "step.h"

/* Whether two sets of outputs differ in nothing that is an event. */
static bool same_situation(const double *a, const double *b)
{
    for (size_t i = 0; i < UNIT_OUTPUTS; ++i)
        if (VARIABLE[OUTPUT_BEGIN + i].kind != REAL && a[i] != b[i]) return false;
    for (size_t fin = 0; fin < FINS; ++fin) {
        const size_t rate = LINE_OUTPUTS + fin * MODEL_OUTPUTS + OUTPUT_FIN_RATE;
        if ((a[rate] == 0.0) != (b[rate] == 0.0)) return false;
    }
    return true;
}

/* Where events are looked for next [s from the start]: where a fin's tick ends, or about where the one after it does
 * if now is its end, or the fins' line has its next instant; and the shortest tick [s]. */
static double next_tick(const instance *m, double *shortest)
{
    double next = HUGE_VAL;
    *shortest = HUGE_VAL;
    for (size_t fin = 0; fin < FINS; ++fin) {
        const core_state *core = &m->s.fins.core[fin];
        const core_schedule plan = core_scheduled(m->fins.p[fin], m->fins.c[fin]);
        const double h = core->position < (int32_t)plan.before ? plan.h_before : plan.h_after;
        const double end = core_begun(core, &plan) + h;
        next = fmin(next, end > m->s.now + m->fins.slack ? end : end + h);
        *shortest = fmin(*shortest, fmin(plan.h_before, plan.h_after));
    }
#if MULTI_FIN_LINE
    if (!multi_fin_stiff(&m->fins)) next = fmin(next, (double)m->s.fins.instant * multi_fin_interval(&m->fins));
#endif
    return next;
}

/* Go on to `end` from a kept state. */
static core_result step_from(instance *m, const multi_fin_state *kept, double from, double end)
{
    m->s.fins = *kept;
    m->s.now = from;
    return held_step(m, end);
}

/* Move on to `*end` [s from the start], or to the first event before it, which `*end` is then; all or nothing. */
static core_result step_to_event(instance *m, double *end, bool *event)
{
    const model_state begun = m->s;
    double before[UNIT_OUTPUTS], shortest;
    core_result result = CORE_DONE;
    memcpy(before, m->s.values + OUTPUT_BEGIN, sizeof before);
    next_tick(m, &shortest);
    if (!((*end - m->s.now) / shortest <= CORE_MOST_TICKS)) return CORE_TOO_MANY_TICKS;
    do { /* once at least, for the outputs' sake */
        const double next = next_tick(m, &shortest);
        const double from = m->s.now, until = next < *end - m->fins.slack ? next : *end;
        const multi_fin_state kept = m->s.fins;
        result = held_step(m, until);
        *event = result == CORE_DONE && !same_situation(before, m->s.values + OUTPUT_BEGIN);
        m->s.now = until;
        if (!*event) continue; /* to the condition */
        double low = from, high = until;
        while (result == CORE_DONE && high - low > m->fins.slack) {
            const double middle = 0.5 * (low + high);
            result = step_from(m, &kept, from, middle);
            if (same_situation(before, m->s.values + OUTPUT_BEGIN))
                low = middle;
            else
                high = middle;
        }
        /* What lies within the tolerance before a tick or an instant is met there. */
        if (until - high <= m->fins.slack) high = until;
        if (result == CORE_DONE) result = step_from(m, &kept, from, high);
        *end = high;
    } while (result == CORE_DONE && !*event && m->s.now < *end);
    if (result != CORE_DONE) m->s = begun;
    return result;
}

/* The same to `end` in one go, however many events there are: whether the situation there is another. */
static core_result step_over_events(instance *m, double end, bool *event)
{
    double before[UNIT_OUTPUTS];
    memcpy(before, m->s.values + OUTPUT_BEGIN, sizeof before);
    const core_result result = held_step(m, end);
    *event = result == CORE_DONE && !same_situation(before, m->s.values + OUTPUT_BEGIN);
    return result;
}

#endif
