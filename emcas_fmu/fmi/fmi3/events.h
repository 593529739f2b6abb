/* Steps that end at events, at which a discrete output changes, or a fin sticks or breaks away. Included by fmi3.c.
 *
 * An event is detected just after the beginning of a tick, where a sample or a reference acts, at the tick's end, or at
 * an update of the fins' line. It is then located by bisection, with steps from copies of the state, to within the
 * tolerance of communication points. The trajectory is that of one long step, since it does not depend on communication
 * points. A change that begins and ends between these instants is detected only if a step ends within it.
 */
#ifndef EMCAS_EVENTS_H
#define EMCAS_EVENTS_H

#include "step.h"

/* Return whether there is no event between two sets of outputs. */
static bool same_situation(const double *a, const double *b)
{
    for (size_t i = 0; i < FMU_OUTPUTS; ++i)
        if (VARIABLE[OUTPUT_BEGIN + i].kind != REAL && a[i] != b[i]) return false;
#ifdef OUTPUT_FIN_RATE
    for (size_t fin = 0; fin < FINS; ++fin) {
        const size_t rate = LINE_OUTPUTS + fin * MODEL_OUTPUTS + OUTPUT_FIN_RATE;
        if ((a[rate] == 0.0) != (b[rate] == 0.0)) return false;
    }
#endif
    return true;
}

/* Return the time [s from the start] at which to look for an event next: the earliest of the instants just after the
 * beginning of a fin's tick, the tick's end, and the next instant of the fins' line. Sets the shortest tick [s]. */
static double next_look(const instance *m, double *shortest)
{
    const double slack = m->fins.slack, just_after = 1.5 * slack; /* within the slack, the tick has not begun */
    double next = HUGE_VAL;
    *shortest = HUGE_VAL;
    for (size_t fin = 0; fin < FINS; ++fin) {
        const core_state *core = &m->s.fins.core[fin];
        const core_schedule plan = core_scheduled(m->fins.p[fin], m->fins.c[fin]);
        const double h = core->time.position < (int32_t)plan.before ? plan.h_before : plan.h_after;
        const double begin = core_begin(core, &plan), end = begin + h;
        next = lesser(next, m->s.now <= begin + slack ? begin + just_after
                            : m->s.now < end - slack  ? end
                                                      : end + just_after);
        *shortest = lesser(*shortest, lesser(plan.h_before, plan.h_after));
    }
#if MULTI_FIN_LINE
    if (!multi_fin_stiff(&m->fins)) next = lesser(next, (double)m->s.fins.instant * multi_fin_interval(&m->fins));
#endif
    return next;
}

/* Step to `end` from a copy of the state at `from`; times in s from the start. */
static core_result step_from(instance *m, const multi_fin_state *copy, double from, double end)
{
    m->s.fins = *copy;
    m->s.now = from;
    return held_step(m, end);
}

/* Step to `*end` [s from the start] or to an event before it; sets `*end` to the time reached. All or nothing. */
static core_result step_to_event(instance *m, double *end, bool *event)
{
    const model_state begun = m->s;
    double before[FMU_OUTPUTS], shortest;
    core_result result = CORE_DONE;
    memcpy(before, m->s.values + OUTPUT_BEGIN, sizeof before);
    next_look(m, &shortest);
    if (!((*end - m->s.now) / shortest <= CORE_MOST_TICKS)) return CORE_TOO_MANY_TICKS;
    do { /* at least once, so that the outputs are computed */
        const double next = next_look(m, &shortest);
        const double from = m->s.now, until = next < *end - m->fins.slack ? next : *end;
        const multi_fin_state copy = m->s.fins;
        result = held_step(m, until);
        *event = result == CORE_DONE && !same_situation(before, m->s.values + OUTPUT_BEGIN);
        m->s.now = until;
        if (!*event) continue; /* tests the loop's condition */
        double low = from, high = until;
        while (result == CORE_DONE && high - low > m->fins.slack) {
            const double middle = 0.5 * (low + high);
            result = step_from(m, &copy, from, middle);
            if (same_situation(before, m->s.values + OUTPUT_BEGIN))
                low = middle;
            else
                high = middle;
        }
        /* An event within the tolerance before `until` is moved there. */
        if (until - high <= m->fins.slack) high = until;
        if (result == CORE_DONE) result = step_from(m, &copy, from, high);
        *end = high;
    } while (result == CORE_DONE && !*event && m->s.now < *end);
    if (result != CORE_DONE) m->s = begun;
    return result;
}

/* Step to `end` past any events; sets `event` to whether the outputs before and after show one. */
static core_result step_over_events(instance *m, double end, bool *event)
{
    double before[FMU_OUTPUTS];
    memcpy(before, m->s.values + OUTPUT_BEGIN, sizeof before);
    const core_result result = held_step(m, end);
    *event = result == CORE_DONE && !same_situation(before, m->s.values + OUTPUT_BEGIN);
    return result;
}

#endif
