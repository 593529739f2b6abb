/* Samples, delay buffers and ticks of one actuator: core.py in C, function by function.
 *
 * kernel.h holds the equations and model.h the sizes, both generated. The state is that at the beginning of a tick. At a
 * communication point inside a tick the outputs come from a tentative step, so that the trajectory does not depend on the
 * host's step sizes.
 */
#ifndef EMCAS_CORE_H
#define EMCAS_CORE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include "kernel.h"
#include "model.h"

/* The plant's states and, behind them, the duration of the last step: kernel_step writes both in place. A copy would
 * be read in wider words than those just written, for which a processor waits. */
typedef struct {
    double x[CORE_PLANT + 1];
} core_plant;

/* Command, loads (aero_torque and the motion loads, which have a mean over a tick), inputs that act through limits, and
 * the actuator's further inputs. Their array has an unused element, since there may be no further input. */
typedef struct {
    double command, loads[CORE_LOADS], supply, enable, further[CORE_FURTHER + 1];
} core_inputs;

/* How the inputs change from those at `begin` [s]; enable and other Booleans do not. */
typedef struct {
    double begin, command, loads[CORE_LOADS], supply, further[CORE_ACTING + 1];
} core_ramp;

/* A tick that contains a communication point: the plant's time within the tick [s], the time up to which inputs are known
 * [s], the inputs at the beginning, and the integrals of the loads' differences from these. */
typedef struct {
    double origin, covered;
    core_inputs first;
    double loads[CORE_LOADS];
} core_part;

/* Everything that changes while running. The line is the delay buffer: the DAC's values up to the present one and, behind
 * them, the commands on their way, the oldest first. There is a part only while `partial`. */
typedef struct {
    int64_t period;
    int32_t position;
    int32_t partial;
    double sampled[CORE_SAMPLED]; /* controller states, measured fin angle, limited, states that steps see */
    double active;
    core_plant plant, tentative;
    double line[CORE_LINE];
    core_part part;
} core_state;

typedef enum { CORE_DONE, CORE_NOT_FINITE, CORE_TOO_MANY_EVENTS, CORE_TOO_MANY_TICKS } core_result;

/* The schedule's numbers, in the order of schedule.py's Schedule. */
typedef struct {
    double period, before, after, arrival, h_before, h_after, samples, late_commands, slack;
} core_schedule;

/* Tests the bits: comparing a NaN would raise a floating-point exception. */
static inline bool core_finite(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return (bits & UINT64_C(0x7ff0000000000000)) != UINT64_C(0x7ff0000000000000);
}

/* The same for many numbers: an exponent of all ones plus one carries into the sign bit. */
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

/* The sum is finite if all terms are, and if they are small enough to be added. */
static inline double core_sum(const double *x, size_t count)
{
    double sum = 0.0;
    for (size_t i = 0; i < count; ++i) sum += x[i];
    return sum;
}

static inline core_schedule core_scheduled(const double *p, const double *c)
{
    double out[9];
    kernel_schedule(p, c, out);
    return (core_schedule){out[0], out[1], out[2], out[3], out[4], out[5], out[6], out[7], out[8]};
}

/* Number of DAC values in the line. */
static inline size_t core_values(const core_schedule *plan)
{
    return (size_t)(int32_t)plan->samples + 2; /* the conversion to a signed integer is one instruction */
}

static inline size_t core_line_length(const core_schedule *plan)
{
    return core_values(plan) + (size_t)(int32_t)plan->late_commands;
}

/* The state at rest at the start. */
static inline void core_start(const double *p, const double *c, core_state *s)
{
    const size_t limited = CORE_CONTROLLER + 1; /* the flag for a limit, which is not among the initial values */
    double out[CORE_PLANT + CORE_SAMPLED - 1];
    kernel_initial(p, c, out);
    memset(s, 0, sizeof *s);
    memcpy(s->plant.x, out, CORE_PLANT * sizeof *out);
    s->tentative = s->plant;
    for (size_t i = 0; i < limited; ++i) s->sampled[i] = out[CORE_PLANT + i];
    for (size_t i = limited + 1; i < CORE_SAMPLED; ++i) s->sampled[i] = out[CORE_PLANT + i - 1];
}

/* The loads that the vehicle's motion causes, which are all but the first, from the inputs of the motion. */
static inline void core_motion_loads(const double *p, const double *c, const double *motion, double *out)
{
    kernel_motion_loads(p, c, MODEL_MOTION_OF(motion), out);
}

/* A core's inputs from an actuator's inputs, in the interface's order, and its motion loads. */
static inline void core_inputs_of(const double *in, const double *motion_loads, core_inputs *out)
{
    out->command = in[INPUT_FIN_COMMAND];
    out->loads[0] = in[INPUT_AERO_TORQUE];
    for (int i = 0; i < CORE_MOTION_LOADS; ++i) out->loads[i + 1] = motion_loads[i];
    out->supply = 0.0;
#if MODEL_SUPPLY >= 0
    out->supply = in[MODEL_SUPPLY];
#endif
    out->enable = in[INPUT_ENABLE];
    memcpy(out->further, in + MODEL_INPUTS - CORE_FURTHER, CORE_FURTHER * sizeof *in);
    out->further[CORE_FURTHER] = 0.0;
}

static inline void core_outputs_of(const double *p, const double *c, const core_state *s, const core_plant *x,
                                   const core_schedule *plan, const core_inputs *in, double *out)
{
    kernel_outputs(p, c, CORE_PLANT_OF(x), s->active, s->line[core_values(plan) - 1], CORE_SHOWN_OF(s) CORE_HELD_OF(s),
                   in->command CORE_LOADS_OF(in), in->supply, in->enable CORE_ACTING_OF(in), out);
}

static inline void core_outputs(const double *p, const double *c, const core_state *s, const core_schedule *plan,
                                const core_inputs *in, double *out)
{
    core_outputs_of(p, c, s, &s->tentative, plan, in, out);
}

/* The inputs at a time of a ramp, stored in `then`; without a ramp (null) the inputs are held. */
static inline const core_inputs *core_at(const core_inputs *in, const core_ramp *ramp, double time, core_inputs *then)
{
    if (!ramp) return in;
    const double t = time - ramp->begin;
    *then = *in;
    then->command += ramp->command * t;
    for (int i = 0; i < CORE_LOADS; ++i) then->loads[i] += ramp->loads[i] * t;
    then->supply += ramp->supply * t;
    for (int i = 0; i < CORE_ACTING; ++i) then->further[i] += ramp->further[i] * t;
    return then;
}

/* Step a plant of `s` over the rest of a tick, `left` [s], from event to event. */
static inline bool core_finish(const double *p, const double *c, const core_state *s, core_plant *x,
                               const core_inputs *in, double left)
{
    if (left <= 0.0) return true;
    for (int i = 0; i < CORE_MOST_EVENTS; ++i) {
        kernel_step(p, c, CORE_PLANT_OF(x) CORE_HELD_OF(s), s->active CORE_LOADS_OF(in), in->supply, in->enable
                    CORE_ACTING_OF(in), left, x->x);
        if (x->x[CORE_PLANT] >= left) return true;
        left -= x->x[CORE_PLANT];
    }
    return false;
}

static inline void core_extend(core_state *s, double until, const core_inputs *in)
{
    core_part *part = &s->part;
    if (!s->partial) {
        *part = (core_part){0.0, until, *in, {0.0}};
        s->partial = 1;
        return;
    }
    const double gained = until - part->covered;
    for (int i = 0; i < CORE_LOADS; ++i) part->loads[i] += gained * (in->loads[i] - part->first.loads[i]);
    part->covered = until;
}

static inline core_inputs core_mean(const core_part *part)
{
    core_inputs mean = part->first;
    const double width = part->covered - part->origin;
    if (width <= 0.0) return mean;
    for (int i = 0; i < CORE_LOADS; ++i) mean.loads[i] += part->loads[i] / width;
    return mean;
}

/* A tick is split where inputs change that act through limits, or in a way that is not known here: the plant advances to
 * the time up to which inputs are known, and a new part begins there. */
static inline bool core_split(const double *p, const double *c, core_state *s, const core_inputs *in)
{
    const core_part *part = &s->part;
    bool differ = part->first.supply != in->supply || part->first.enable != in->enable;
    for (int i = 0; i < CORE_ACTING; ++i) differ |= part->first.further[i] != in->further[i];
    if (!differ) return true;
    const core_inputs mean = core_mean(part);
    const double covered = part->covered;
    const bool followed = core_finish(p, c, s, &s->plant, &mean, covered - part->origin);
    s->part = (core_part){covered, covered, *in, {0.0}};
    return followed;
}

static inline void core_sample(const double *p, const double *c, core_state *s, const core_schedule *plan,
                               const core_inputs *in)
{
    double out[1 + CORE_SAMPLED], command = in->command;
    const core_plant *x = &s->plant;
    const size_t line = core_values(plan), late = (size_t)(int32_t)plan->late_commands;
    if (late) {
        double *commands = s->line + line;
        command = commands[0];
        memmove(commands, commands + 1, (late - 1) * sizeof *commands);
        commands[late - 1] = in->command;
    }
    kernel_sample(p, c, CORE_PLANT_OF(x) CORE_CONTROLLER_OF(s) CORE_HELD_OF(s), command, in->supply,
                  in->enable CORE_FURTHER_OF(in), out);
    memmove(s->line, s->line + 1, (line - 1) * sizeof *s->line);
    s->line[line - 1] = out[0];
    memcpy(s->sampled, out + 1, sizeof s->sampled);
}

/* The time at which the present tick begins [s]. */
static inline double core_begun(const core_state *s, const core_schedule *plan)
{
    const double within = s->position < (int32_t)plan->before ? s->position * plan->h_before
                                                              : plan->arrival + (s->position - plan->before) * plan->h_after;
    return (double)s->period * plan->period + within;
}

/* Advance to `until` [s] within a tick; `whole` is the rest of it, after which there is no part. */
static inline bool core_tick(const double *p, const double *c, core_state *s, const core_schedule *plan,
                             const core_inputs *in, const core_ramp *ramp, double until, bool whole)
{
    const double begun = ramp ? core_begun(s, plan) : 0.0;
    core_inputs sampled, middle, mean;
    const core_inputs *acting = core_at(in, ramp, begun + 0.5 * (s->partial ? until + s->part.covered : until), &middle);
    if (s->position == 0 && !s->partial) core_sample(p, c, s, plan, core_at(in, ramp, begun, &sampled));
    s->active = s->line[s->position < (int32_t)plan->before ? 0 : 1];
    double origin = 0.0;
    if (s->partial) {
        if (!core_split(p, c, s, acting)) return false;
        origin = s->part.origin;
    }
    if (s->partial || !whole) {
        core_extend(s, until, acting);
        mean = core_mean(&s->part);
        acting = &mean;
    }
    if (whole) {
        s->partial = 0;
        return core_finish(p, c, s, &s->plant, acting, until - origin);
    }
    s->tentative = s->plant;
    return core_finish(p, c, s, &s->tentative, acting, until - origin);
}

/* Advance as core_run does, but without restoring the state if the equations cannot be followed. */
static inline core_result core_move(const double *p, const double *c, core_state *s, const core_schedule *plan,
                                    double end, const core_inputs *in, const core_ramp *ramp, double *out)
{
    const int32_t ticks = (int32_t)(plan->before + plan->after);
    double at[3] = {(double)(s->period + 1), 0.0, 0.0}; /* most hosts step from sample to sample */
    const double beyond = end - at[0] * plan->period;
    if (!(beyond <= plan->slack && -plan->slack <= beyond)) kernel_locate(p, c, end, at);
    if (!((at[0] - (double)s->period) * ticks <= CORE_MOST_TICKS)) return CORE_TOO_MANY_TICKS;
    int64_t period = (int64_t)(at[0] > -1.0 ? at[0] : -1.0); /* any time before the start is like the start */
    int32_t position = (int32_t)at[1];
    double rest = at[2];
    if (period < s->period || (period == s->period && position <= s->position)) { /* time never goes back */
        const double covered = s->partial ? s->part.covered : 0.0;
        const bool behind = period < s->period || position < s->position;
        period = s->period;
        position = s->position;
        if (behind || rest < covered) rest = covered;
    }
    /* The number of ticks is computed first, so that the loop ends whatever the state was. */
    for (int64_t left = (period - s->period) * ticks + (position - s->position); left > 0; --left) {
        const double h = s->position < (int32_t)plan->before ? plan->h_before : plan->h_after;
        if (!core_tick(p, c, s, plan, in, ramp, h, true)) return CORE_TOO_MANY_EVENTS;
        if (++s->position == ticks) {
            s->position = 0;
            ++s->period;
        }
    }
    const core_plant *reached = &s->plant; /* not the copy, for which the processor would wait */
    s->tentative = s->plant;
    if (rest > 0.0) {
        if (!core_tick(p, c, s, plan, in, ramp, rest, false)) return CORE_TOO_MANY_EVENTS;
        reached = &s->tentative;
    }
    core_inputs final;
    double outputs[MODEL_OUTPUTS];
    core_outputs_of(p, c, s, reached, plan, core_at(in, ramp, end, &final), outputs);
    if (!core_finite(core_sum(s->sampled, CORE_SAMPLED) + core_sum(reached->x, CORE_PLANT)
                     + core_sum(outputs, MODEL_OUTPUTS)))
        return CORE_NOT_FINITE;
    memcpy(out, outputs, sizeof outputs);
    return CORE_DONE;
}

/* Advance to `end` [s] from the start, all or nothing, with the inputs held or changing by a `ramp` (null: held). The
 * outputs there are written to `out`. */
static inline core_result core_run(const double *p, const double *c, core_state *s, double end,
                                   const core_inputs *in, const core_ramp *ramp, double *out)
{
    const core_schedule plan = core_scheduled(p, c);
    const size_t used = offsetof(core_state, line) + core_line_length(&plan) * sizeof *s->line;
    core_state before;
    memcpy(&before, s, used);
    if (s->partial) before.part = s->part;
    const core_result result = core_move(p, c, s, &plan, end, in, ramp, out);
    if (result != CORE_DONE) {
        memcpy(s, &before, used);
        if (s->partial) s->part = before.part;
    }
    return result;
}

#endif
