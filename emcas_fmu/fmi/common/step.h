/* Communication steps of an instance: checks before a step and the status after it. Common to all versions of FMI. */
#ifndef EMCAS_STEP_H
#define EMCAS_STEP_H

#include "instance.h"

static int bad_inputs(const instance *m, double time)
{
    int status = FMI(OK);
    for (size_t i = 0; i < FMU_INPUTS; ++i)
        if (!core_finite(m->s.values[i]))
            status = report(m, FMI(Error), "input at %.17g s is not finite: %s = %.9g", time, VARIABLE[i].name,
                            m->s.values[i]);
    return status;
}

/* At the first command other than 0, warn if supply or enable is 0: the input may be unconnected. */
static void check_drive(instance *m, const core_inputs *in)
{
    for (size_t fin = 0; fin < FINS && !m->commanded; ++fin) {
        if (in[fin].command == 0.0) continue;
        m->commanded = 1;
        if (*NO_SUPPLY && in[fin].supply == 0.0) report(m, FMI(Warning), UNCONNECTED, NO_SUPPLY);
        if (in[fin].enable == 0.0) report(m, FMI(Warning), UNCONNECTED, "enable = 0");
    }
}

static core_result run(instance *m, double end, const core_inputs *in, const core_ramp *ramp)
{
    if (!m->commanded) check_drive(m, in);
    return multi_fin_run(&m->fins, &m->s.fins, m->s.now, end, in, ramp, m->s.values + OUTPUT_BEGIN);
}

static core_result held_step(instance *m, double end)
{
    core_inputs in[FINS];
    acting_now(m, in);
    return run(m, end, in, NULL);
}

/* Check and prepare a step of `size` [s] from `time` [s]; set its `end` [s from the start]. Returns its status. */
static int step_end(instance *m, double time, double size, double *end)
{
    if (!core_finite(time) || !core_finite(size) || !(size > 0.0))
        return report(m, FMI(Error), "communication step %.17g s at %.17g s is not positive and finite", size, time);
    if (m->check_inputs) {
        if (!core_all_finite(m->s.values, FMU_INPUTS)) return bad_inputs(m, time);
        m->check_inputs = 0;
    }
    if (m->pending) {
        if (!sound(m, FMI(Discard))) return FMI(Discard);
        prepare(m);
        all_rules_kept(m, FMI(Warning));
    }
    const double begin = time - m->s.start;
    /* Far from 0, the rounding of a host's times may exceed the slack. */
    if (!(fabs(begin - m->s.now) <= m->fins.slack + 4.0 * DBL_EPSILON * fabs(time)))
        return report(m, FMI(Error), "step from %.17g s, but the instance is at %.17g s, %.3g s away", time,
                      m->s.start + m->s.now, begin - m->s.now);
    /* A host that sums its steps may miss the stop time, by up to 1e-9 of it. */
    if (time + size > m->s.stop + m->fins.slack + 1e-9 * fabs(m->s.stop))
        return report(m, FMI(Error), "step of %.17g s from %.17g s ends after the stop time, %.17g s", size, time,
                      m->s.stop);
    *end = begin + size;
    if (*end < m->s.now) *end = m->s.now; /* a host's clock may go back within the slack, the trajectory does not */
    if (m->moved) update_motion_loads_now(m);
#ifdef STEP_BEGIN
    m->s.values[STEP_BEGIN] = begin; /* a new time: the equations adopt the motion of the host's fin */
#endif
    return FMI(OK);
}

/* Return the status of a step; advance the time to `end` if it was computed. */
static int step_done(instance *m, core_result result, double time, double size, double end)
{
    static const char *const REASON[] = CORE_REASONS;
    if (result != CORE_DONE)
        return report(m, FMI(Discard), "step of %.17g s from %.17g s: %s", size, time, REASON[result]);
    m->s.fresh = 1;
    m->s.now = end;
    return FMI(OK);
}

#endif
