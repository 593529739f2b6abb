/* The clock of the controllers' samples; included by fmi3.c. */
#ifndef EMCAS_CLOCK_H
#define EMCAS_CLOCK_H

#include "instance.h"

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Clock value[])
{
    const instance *m = c;
    if (!are_of(m, HANDLING_EVENT, TICKS, vr, n, value, n, __func__)) return fmi3Error;
    for (size_t i = 0; i < n; ++i) value[i] = m->ticks;
    return fmi3OK;
}

/* Activating the clock is allowed only at a sample, and changes nothing: the controllers also sample without it. */
fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Clock value[])
{
    instance *m = c;
    if (!are_of(m, HANDLING_EVENT, TICKS, vr, n, value, n, __func__)) return fmi3Error;
    for (size_t i = 0; i < n; ++i) {
        const core_state *core = m->s.fins.core;
        if (!value[i] && m->ticks)
            return report(m, fmi3Error, "fmi3SetClock: %s cannot be deactivated", CLOCK_NAME);
        if (value[i] && (core->time.position != 0 || core->time.partial))
            return report(m, fmi3Error, "fmi3SetClock: %s does not tick at %.17g s, which is not a sample",
                          CLOCK_NAME, m->s.start + m->s.now);
    }
    for (size_t i = 0; i < n; ++i) m->ticks = value[i];
    return fmi3OK;
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[])
{
    instance *m = c;
    if (!are_of(m, INITIALIZING | DURING_RUN, TICKS, vr, n, intervals, n, __func__)) return fmi3Error;
    if (!allowed_with(m, INITIALIZING | DURING_RUN, n, qualifiers, qualifiers, __func__)) return fmi3Error;
    for (size_t i = 0; i < n; ++i) {
        intervals[i] = parameters(m, 0)[SAMPLE_TIME];
        qualifiers[i] = m->interval_known ? fmi3IntervalUnchanged : fmi3IntervalChanged;
        m->interval_known = m->s.phase != INITIALIZING; /* the sample time is fixed after initialization */
    }
    return fmi3OK;
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[])
{
    if (!are_of(c, INITIALIZING | DURING_RUN, TICKS, vr, n, shifts, n, __func__)) return fmi3Error;
    for (size_t i = 0; i < n; ++i) shifts[i] = 0.0;
    return fmi3OK;
}

#endif
