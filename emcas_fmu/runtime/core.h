/* Samples, delay buffers and ticks of actuators that are stepped together: core.py in C.
 *
 * `core_x` is the method x or _x of Core, core_move its _run, core_scheduled its bind, core_inputs_of the function
 * inputs_of; the other functions serve ramps of the inputs, lanes and memory. states.h checks stored states as
 * Core.unsound does.
 *
 * Lanes (core_state.h) move together while their samples and ticks coincide; `which` are the lanes that move, values of
 * the others have no meaning. The state is that at the beginning of a tick. At a communication point inside a tick the
 * outputs come from a tentative step, so that the trajectory does not depend on the host's step sizes.
 */
#ifndef EMCAS_CORE_H
#define EMCAS_CORE_H

#include "core_state.h"

/* Return whether a number is finite, by its bits: comparing a NaN would raise a floating-point exception. */
static inline bool core_finite(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (bits & UINT64_C(0x7ff0000000000000)) != UINT64_C(0x7ff0000000000000);
}

/* Return whether many numbers are finite: an exponent of all ones plus one carries into the sign bit. */
static inline bool core_all_finite(const double *x, size_t count)
{
    uint64_t carries = 0;
    for (size_t i = 0; i < count; ++i) {
        uint64_t bits;
        memcpy(&bits, &x[i], sizeof bits);
        carries |= (bits & UINT64_C(0x7ff0000000000000)) + UINT64_C(0x0010000000000000);
    }
    return !(carries >> 63);
}

/* Return a sum, which is not finite if a term is not or the sum overflows. The sum of vectors has four parts, which a
 * processor adds in parallel. */
static inline lanes core_sum(const lanes *x, int count)
{
    enum { PARTS = LANES > 1 ? 4 : 1 };
    lanes sum[4] = {lanes_set(0.0), lanes_set(0.0), lanes_set(0.0), lanes_set(0.0)};
#ifdef __GNUC__
#pragma GCC unroll 32
#endif
    for (int i = 0; i < count; ++i) sum[i % PARTS] = sum[i % PARTS] + x[i];
    if (LANES == 1) return sum[0];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

static inline core_schedule core_scheduled(const lanes *p, const lanes *c)
{
    core_schedule plan;
    EQUATIONS(schedule, EVERY_LANE, p, c, (lanes *)&plan);
    return plan;
}

/* Return a whole number of the schedule, read from lane 0. The conversion to a signed integer is one instruction. */
static inline int32_t core_count(lanes number)
{
    return (int32_t)lanes_of(number, 0);
}

/* Return the number of DAC values in the delay buffer. */
static inline size_t core_values(const core_schedule *plan)
{
    return (size_t)core_count(plan->delay_samples) + 2;
}

static inline size_t core_line_length(const core_schedule *plan)
{
    return core_values(plan) + (size_t)core_count(plan->late_commands);
}

/* Set the state at rest at the start, in memory that is all 0. */
static inline void core_start(const lanes *p, const lanes *c, core_state *s)
{
    const size_t limited = CORE_CONTROLLER + 1; /* the flag for a limit, which is not among the initial values */
    lanes out[CORE_PLANT + CORE_SAMPLED - 1];
    EQUATIONS(initial, EVERY_LANE, p, c, out);
    memcpy(s->plant.x, out, CORE_PLANT * sizeof *out);
    s->tentative = s->plant;
    for (size_t i = 0; i < limited; ++i) s->sampled[i] = out[CORE_PLANT + i];
    for (size_t i = limited + 1; i < CORE_SAMPLED; ++i) s->sampled[i] = out[CORE_PLANT + i - 1];
}

/* Compute the motion loads, which are all loads but the first, from the inputs of the vehicle's motion. */
static inline void core_motion_loads(const lanes *p, const lanes *c, const lanes *motion, lanes *out)
{
    EQUATIONS(motion_loads, EVERY_LANE, p, c, MODEL_MOTION_OF(motion), out);
}

/* Compute a core's inputs from an actuator's inputs, in the interface's order, and its motion loads. */
static inline void core_inputs_of(const lanes *in, const lanes *motion_loads, core_inputs *out)
{
    out->command = in[INPUT_FIN_COMMAND];
    out->loads[0] = in[INPUT_AERO_TORQUE];
    for (int i = 0; i < CORE_MOTION_LOADS; ++i) out->loads[i + 1] = motion_loads[i];
    out->supply = lanes_set(0.0);
#if MODEL_SUPPLY >= 0
    out->supply = in[MODEL_SUPPLY];
#endif
    out->enable = in[INPUT_ENABLE];
    memcpy(out->further, in + MODEL_INPUTS - CORE_FURTHER, CORE_FURTHER * sizeof *in);
    out->further[CORE_FURTHER] = lanes_set(0.0);
}

/* Compute the outputs of `s` with `x`, which is its plant or tentative plant. */
static inline void core_outputs(const lanes *p, const lanes *c, lanes_mask which, const core_state *s,
                                const core_plant *x, const core_schedule *plan, const core_inputs *in, lanes *out)
{
    EQUATIONS(outputs, which, p, c, CORE_PLANT_OF(x), s->active, s->line[core_values(plan) - 1],
              CORE_SHOWN_OF(s) CORE_HELD_OF(s), in->command CORE_LOADS_OF(in), in->supply,
              in->enable CORE_ACTING_OF(in), out);
}

/* Return the inputs at a time [s] of a ramp, stored in `then`; without a ramp (null) return the held inputs. */
static inline const core_inputs *core_at(const core_inputs *in, const core_ramp *ramp, lanes time, core_inputs *then)
{
    if (!ramp) return in;
    const lanes t = time - ramp->begin;
    *then = *in;
    then->command = then->command + ramp->command * t;
    for (int i = 0; i < CORE_LOADS; ++i) then->loads[i] = then->loads[i] + ramp->loads[i] * t;
    then->supply = then->supply + ramp->supply * t;
    for (int i = 0; i < CORE_ACTING; ++i) then->further[i] = then->further[i] + ramp->further[i] * t;
    return then;
}

/* Step a plant of `s` over the rest of a tick, `left` [s], from event to event; returns the lanes that reached the
 * tick's end. */
static inline lanes_mask core_finish(const lanes *p, const lanes *c, lanes_mask which, const core_state *s,
                                     core_plant *x, const core_inputs *in, lanes left)
{
    lanes_mask moving = lanes_both(which, lanes_greater(left, lanes_set(0.0)));
    for (int i = 0; i < CORE_MOST_EVENTS && lanes_any(moving); ++i) {
        lanes out[CORE_PLANT + 1], *moved = LANES > 1 ? out : x->x; /* the other lanes keep their states */
        EQUATIONS(step, moving, p, c, CORE_PLANT_OF(x) CORE_HELD_OF(s), s->active CORE_LOADS_OF(in), in->supply,
                  in->enable CORE_ACTING_OF(in), left, moved);
        for (int k = 0; LANES > 1 && k < CORE_PLANT; ++k) x->x[k] = lanes_where(moving, moved[k], x->x[k]);
        const lanes used = moved[CORE_PLANT], most = left * lanes_set(1.0 + 1e-9); /* the rest, with its rounding */
        moving = lanes_but(moving, lanes_both(lanes_greater_equal(used, left), lanes_less_equal(used, most)));
        left = left - used;
    }
    return lanes_but(which, moving);
}

static inline void core_extend(core_state *s, lanes until, const core_inputs *in)
{
    core_part *part = &s->part;
    if (!s->time.partial) {
        *part = (core_part){lanes_set(0.0), until, *in, {lanes_set(0.0)}};
        s->time.partial = 1;
        return;
    }
    const lanes gained = until - part->covered;
    for (int i = 0; i < CORE_LOADS; ++i)
        part->loads[i] = part->loads[i] + gained * (in->loads[i] - part->first.loads[i]);
    part->covered = until;
}

static inline core_inputs core_mean(const core_part *part)
{
    core_inputs mean = part->first;
    const lanes width = part->covered - part->origin;
    const lanes_mask wide = lanes_greater(width, lanes_set(0.0));
    for (int i = 0; i < CORE_LOADS; ++i)
        mean.loads[i] = lanes_where(wide, mean.loads[i] + part->loads[i] / lanes_where(wide, width, lanes_set(1.0)),
                                    mean.loads[i]);
    return mean;
}

/* Split a tick where an input changes that acts through limits (supply, enable) or in a way that is not known here: the
 * plant advances to the time up to which inputs are known, and a new part begins. Returns the lanes that got there. */
static inline lanes_mask core_split(const lanes *p, const lanes *c, lanes_mask which, core_state *s,
                                    const core_inputs *in)
{
    core_part *part = &s->part;
    const core_inputs *first = &part->first;
    lanes_mask same = lanes_both(lanes_equal(first->supply, in->supply), lanes_equal(first->enable, in->enable));
    for (int i = 0; i < CORE_ACTING; ++i) same = lanes_both(same, lanes_equal(first->further[i], in->further[i]));
    const lanes_mask differ = lanes_but(which, same);
    if (!lanes_any(differ)) return lanes_but(which, NO_LANE);
    const core_inputs mean = core_mean(part);
    const lanes_mask reached = core_finish(p, c, differ, s, &s->plant, &mean, part->covered - part->origin);
    const core_part next = {part->covered, part->covered, *in, {lanes_set(0.0)}};
    for (size_t i = 0; i < sizeof next / sizeof(lanes); ++i)
        ((lanes *)part)[i] = lanes_where(differ, ((const lanes *)&next)[i], ((lanes *)part)[i]);
    return lanes_but(which, lanes_but(differ, reached));
}

/* Drop the first value and append a last one. */
static inline void core_push(lanes *values, size_t count, lanes last)
{
    memmove(values, values + 1, (count - 1) * sizeof *values);
    values[count - 1] = last;
}

static inline void core_sample(const lanes *p, const lanes *c, lanes_mask which, core_state *s,
                               const core_schedule *plan, const core_inputs *in)
{
    lanes out[1 + CORE_SAMPLED], command = in->command;
    const core_plant *x = &s->plant;
    const size_t line = core_values(plan), late = (size_t)core_count(plan->late_commands);
    if (late) {
        command = s->line[line];
        core_push(s->line + line, late, in->command);
    }
    EQUATIONS(sample, which, p, c, CORE_PLANT_OF(x) CORE_CONTROLLER_OF(s) CORE_HELD_OF(s), command, in->supply,
              in->enable CORE_FURTHER_OF(in), out);
    core_push(s->line, line, out[0]);
    memcpy(s->sampled, out + 1, sizeof s->sampled);
}

/* Return the time at which the present tick begins [s]. */
static inline lanes core_begin(const core_state *s, const core_schedule *plan)
{
    const lanes position = lanes_set(s->time.position);
    lanes within = position * plan->h_before;
    if (s->time.position >= core_count(plan->before))
        within = plan->arrival + (position - plan->before) * plan->h_after;
    return lanes_set((double)s->time.period) * plan->sample_time + within;
}

/* Advance to `until` [s] within a tick; if `whole`, the tick ends there, and there is no part afterwards. Returns the
 * lanes that reached `until`. */
static inline lanes_mask core_tick(const lanes *p, const lanes *c, lanes_mask which, core_state *s,
                                   const core_schedule *plan, const core_inputs *in, const core_ramp *ramp, lanes until,
                                   bool whole)
{
    const lanes begin = ramp ? core_begin(s, plan) : lanes_set(0.0);
    const lanes covered = s->time.partial ? s->part.covered : lanes_set(0.0);
    core_inputs sampled, middle, mean;
    const core_inputs *acting = core_at(in, ramp, begin + lanes_set(0.5) * (until + covered), &middle);
    if (s->time.position == 0 && !s->time.partial)
        core_sample(p, c, which, s, plan, core_at(in, ramp, begin, &sampled));
    s->active = s->line[s->time.position < core_count(plan->before) ? 0 : 1];
    lanes origin = lanes_set(0.0);
    if (s->time.partial) {
        which = core_split(p, c, which, s, acting);
        if (!lanes_any(which)) return NO_LANE;
        origin = s->part.origin;
    }
    if (s->time.partial || !whole) {
        core_extend(s, until, acting);
        mean = core_mean(&s->part);
        acting = &mean;
    }
    if (whole) {
        s->time.partial = 0;
        return core_finish(p, c, which, s, &s->plant, acting, until - origin);
    }
    s->tentative = s->plant;
    return core_finish(p, c, which, s, &s->tentative, acting, until - origin);
}

/* Advance the lanes `which`, at least one, as core_run does, as far as they move together, but without restoring the
 * state. Returns the lanes that reached `end`, and sets `why` to the reason why others did not. */
static inline lanes_mask core_move(const lanes *p, const lanes *c, lanes_mask which, core_state *s,
                                   const core_schedule *plan, double end, const core_inputs *in, const core_ramp *ramp,
                                   lanes *out, core_result *why)
{
    const int32_t ticks = (int32_t)lanes_of(plan->before + plan->after, 0);
    const int lead = lanes_lead(which);
    /* Most hosts step from sample to sample. */
    lanes at[3] = {lanes_set((double)(s->time.period + 1)), lanes_set(0.0), lanes_set(0.0)};
    const lanes_mask near = lanes_less_equal(lanes_fabs(lanes_set(end) - at[0] * plan->sample_time), plan->slack);
    if (lanes_any(lanes_but(which, near))) {
        lanes located[3];
        EQUATIONS(locate, which, p, c, lanes_set(end), located);
        for (int i = 0; i < 3; ++i) at[i] = lanes_where(near, at[i], located[i]);
    }
    const double periods = lanes_of(at[0], lead);
    *why = CORE_TOO_MANY_TICKS;
    if (!((periods - (double)s->time.period) * ticks <= CORE_MOST_TICKS)) return NO_LANE;
    lanes_mask moving = lanes_both(which, lanes_both(lanes_alike(at[0], lead), lanes_alike(at[1], lead)));
    int64_t period = (int64_t)(periods > -1.0 ? periods : -1.0); /* any time before the start counts as the start */
    int32_t position = (int32_t)lanes_of(at[1], lead);
    lanes rest = at[2];
    /* Time never goes back. */
    if (period < s->time.period || (period == s->time.period && position <= s->time.position)) {
        const lanes covered = s->time.partial ? s->part.covered : lanes_set(0.0);
        const bool behind = period < s->time.period || position < s->time.position;
        period = s->time.period;
        position = s->time.position;
        rest = behind ? covered : lanes_where(lanes_less(rest, covered), covered, rest);
    }
    /* The number of ticks is computed first, so that the loop ends whatever the state was. */
    *why = CORE_TOO_MANY_EVENTS;
    for (int64_t left = (period - s->time.period) * ticks + (position - s->time.position); left > 0; --left) {
        const lanes h = s->time.position < core_count(plan->before) ? plan->h_before : plan->h_after;
        moving = core_tick(p, c, moving, s, plan, in, ramp, h, true);
        if (!lanes_any(moving)) return NO_LANE;
        if (++s->time.position == ticks) {
            s->time.position = 0;
            ++s->time.period;
        }
    }
    const core_plant *reached = &s->plant; /* not s->tentative: the processor would wait for the copy */
    s->tentative = s->plant;
    const lanes_mask inside = lanes_both(moving, lanes_greater(rest, lanes_set(0.0)));
    if (lanes_any(inside)) {
        moving = core_tick(p, c, inside, s, plan, in, ramp, rest, false);
        if (!lanes_any(moving)) return NO_LANE;
        reached = &s->tentative;
    }
    core_inputs final;
    core_outputs(p, c, moving, s, reached, plan, core_at(in, ramp, lanes_set(end), &final), out);
    *why = CORE_NOT_FINITE;
    return lanes_both(moving, lanes_finite(core_sum(s->sampled, CORE_SAMPLED) + core_sum(reached->x, CORE_PLANT)
                                             + core_sum(out, MODEL_OUTPUTS)));
}

/* Copy the used values of a state: `line` values of the delay buffer, and the part of a tick if `partial`. */
static inline void core_keep(const core_state *s, core_state *to, size_t line, bool partial)
{
    const size_t begin = offsetof(core_state, time), end = offsetof(core_state, line) + line * sizeof *s->line;
    memcpy((char *)to + begin, (const char *)s + begin, end - begin);
    if (partial) to->part = s->part;
}

/* Advance to `end` [s from the start], all or nothing, with inputs that change by a `ramp` (null: held). The outputs
 * there are written to `out`; they have no meaning if the end was not reached. */
static inline core_result core_run(const lanes *p, const lanes *c, core_state *s, double end, const core_inputs *in,
                                   const core_ramp *ramp, lanes *out)
{
    const core_schedule plan = core_scheduled(p, c);
    const size_t line = core_line_length(&plan);
    core_state before;
    core_result why;
    core_keep(s, &before, line, s->time.partial);
    if (lanes_every(core_move(p, c, EVERY_LANE, s, &plan, end, in, ramp, out, &why))) return CORE_DONE;
    core_keep(&before, s, line, before.time.partial);
    return why;
}

#endif
