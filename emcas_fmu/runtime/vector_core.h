/* Stepping of LANES actuators side by side: core.h over vectors, function by function.
 *
 * Lanes move together while their samples and ticks coincide; `which` are the lanes that do. The others, and those whose
 * equations cannot be followed, are moved by core.h alone, from a copy of their state. */
#ifndef EMCAS_VECTOR_CORE_H
#define EMCAS_VECTOR_CORE_H

#include "core.h"
#include "vector.h"
#include "vector_kernel.h"

typedef struct {
    lanes x[CORE_PLANT];
} group_plant;

typedef struct {
    lanes command, loads[CORE_LOADS], supply, enable, further[CORE_FURTHER + 1];
} group_inputs;

typedef struct {
    lanes period, before, after, arrival, h_before, h_after, samples, late_commands, slack;
} group_schedule;

/* Parameters of LANES actuators and, behind them, the constants computed from these. */
enum { GROUP_VALUES = MODEL_PARAMETERS + KERNEL_CONSTANTS };

typedef struct {
    lanes values[GROUP_VALUES];
} group_parameters;

/* The members that every step needs are together, at the end; those of a core_part come first. A lane's time is `period`,
 * `position` and `partial`, as in core_state. */
typedef struct {
    lanes origin, covered, loads[CORE_LOADS];
    group_inputs first;
    int64_t period[LANES];
    int32_t position[LANES], partial[LANES];
    lanes sampled[CORE_SAMPLED], active;
    group_plant plant, tentative;
    lanes line[CORE_LINE];
} group_state;

/* `motion_loads` are those of `motion`; `common_motion` is its number if all groups have the same motion, else 0. */
typedef struct {
    uint64_t common_motion;
    lanes motion[MODEL_MOTION], motion_loads[CORE_MOTION_LOADS];
    group_state state; /* with a line as long as the longest of the batch */
} group;

/* A step of a group: the values that its lanes have in common. */
typedef struct {
    const lanes *p, *c;
    group_schedule plan;
    double end;
    lanes at[3]; /* period, position and rest of `end` */
    int32_t before, ticks;
    size_t values, late, line; /* numbers of DAC values, of delayed commands, and of both in the longest lane */
    unsigned together;         /* lanes whose schedule has the same numbers as that of lane 0 */
} group_step;

static inline lanes group_lane(const lanes *x, int lane)
{
    return lanes_set(((const double *)x)[lane]);
}

static inline double *group_at(lanes *x, int lane)
{
    return (double *)x + lane;
}

/* The lanes that have reached the same time as `lane`. */
static inline unsigned group_beside(const group_state *s, int lane)
{
    unsigned beside = 0;
    for (int l = 0; l < LANES; ++l)
        beside |= (unsigned)(s->period[l] == s->period[lane] && s->position[l] == s->position[lane]
                             && s->partial[l] == s->partial[lane]) << l;
    return beside;
}

/* The lanes of `which` (at least one) that have reached the latest time, and so can move together. */
static inline unsigned group_together(const group_state *s, unsigned which)
{
    int lead = __builtin_ctz(which);
    const unsigned beside = which & group_beside(s, lead);
    if (beside == which) return which;
    for (int l = lead + 1; l < LANES; ++l)
        if (which >> l & 1u && (s->period[l] > s->period[lead]
                                || (s->period[l] == s->period[lead] && s->position[l] > s->position[lead]))) lead = l;
    return which & group_beside(s, lead);
}

/* A sum that is finite only where all terms are; in four independent parts, which a processor adds in parallel. */
static inline lanes group_sum(const lanes *x, int count)
{
    lanes sum[4] = {lanes_set(0.0), lanes_set(0.0), lanes_set(0.0), lanes_set(0.0)};
#pragma GCC unroll 32
    for (int i = 0; i < count; ++i) sum[i % 4] = sum[i % 4] + x[i];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
}

static inline void group_outputs(const group_step *g, unsigned which, const group_state *s, const group_inputs *in,
                                 lanes *out)
{
    const group_plant *x = &s->tentative;
    vector_outputs(which, g->p, g->c, CORE_PLANT_OF(x), s->active, s->line[g->values - 1], CORE_SHOWN_OF(s)
                   CORE_HELD_OF(s), in->command CORE_LOADS_OF(in), in->supply, in->enable CORE_ACTING_OF(in), out);
}

/* Returns the lanes that reached the end of the tick. */
static inline lanes_mask group_finish(const group_step *g, lanes_mask which, const group_state *s, group_plant *x,
                                      const group_inputs *in, lanes left)
{
    lanes_mask moving = lanes_both(which, lanes_greater(left, lanes_set(0.0)));
    for (int i = 0; i < CORE_MOST_EVENTS && lanes_any(moving); ++i) {
        lanes out[CORE_PLANT + 1];
        vector_step(lanes_bits(moving), g->p, g->c, CORE_PLANT_OF(x) CORE_HELD_OF(s), s->active CORE_LOADS_OF(in), in->supply,
                    in->enable CORE_ACTING_OF(in), left, out);
        for (int k = 0; k < CORE_PLANT; ++k) x->x[k] = lanes_where(moving, out[k], x->x[k]);
        moving = lanes_but(moving, lanes_greater_equal(out[CORE_PLANT], left));
        left = left - out[CORE_PLANT];
    }
    return lanes_but(which, moving);
}

static inline void group_extend(group_state *s, lanes until, const group_inputs *in)
{
    if (!s->partial[0]) {
        s->origin = lanes_set(0.0);
        s->first = *in;
        for (int i = 0; i < CORE_LOADS; ++i) s->loads[i] = lanes_set(0.0);
    } else {
        const lanes gained = until - s->covered;
        for (int i = 0; i < CORE_LOADS; ++i) s->loads[i] = s->loads[i] + gained * (in->loads[i] - s->first.loads[i]);
    }
    s->covered = until;
}

static inline group_inputs group_mean(const group_state *s)
{
    group_inputs mean = s->first;
    const lanes width = s->covered - s->origin;
    const lanes_mask wide = lanes_greater(width, lanes_set(0.0));
    for (int i = 0; i < CORE_LOADS; ++i)
        mean.loads[i] = lanes_where(wide, mean.loads[i] + s->loads[i] / lanes_where(wide, width, lanes_set(1.0)),
                                    mean.loads[i]);
    return mean;
}

static inline lanes_mask group_split(const group_step *g, lanes_mask which, group_state *s, const group_inputs *in)
{
    lanes_mask same = lanes_both(lanes_equal(s->first.supply, in->supply), lanes_equal(s->first.enable, in->enable));
    for (int i = 0; i < CORE_ACTING; ++i) same = lanes_both(same, lanes_equal(s->first.further[i], in->further[i]));
    const lanes_mask differ = lanes_but(which, same);
    if (!lanes_any(differ)) return which;
    const group_inputs mean = group_mean(s);
    const lanes_mask done = group_finish(g, differ, s, &s->plant, &mean, s->covered - s->origin);
    s->origin = lanes_where(differ, s->covered, s->origin);
    lanes *first = (lanes *)&s->first;
    for (size_t i = 0; i < sizeof s->first / sizeof *first; ++i)
        first[i] = lanes_where(differ, ((const lanes *)in)[i], first[i]);
    for (int i = 0; i < CORE_LOADS; ++i) s->loads[i] = lanes_where(differ, lanes_set(0.0), s->loads[i]);
    return lanes_but(which, lanes_but(differ, done));
}

static inline void group_sample(const group_step *g, lanes_mask which, group_state *s, const group_inputs *in)
{
    lanes out[1 + CORE_SAMPLED], command = in->command;
    const group_plant *x = &s->plant;
    if (g->late) {
        lanes *commands = s->line + g->values;
        command = commands[0];
        for (size_t i = 1; i < g->late; ++i) commands[i - 1] = commands[i];
        commands[g->late - 1] = in->command;
    }
    vector_sample(lanes_bits(which), g->p, g->c, CORE_PLANT_OF(x) CORE_CONTROLLER_OF(s) CORE_HELD_OF(s), command, in->supply,
                  in->enable CORE_FURTHER_OF(in), out);
    for (size_t i = 1; i < g->values; ++i) s->line[i - 1] = s->line[i];
    s->line[g->values - 1] = out[0];
    memcpy(s->sampled, out + 1, sizeof s->sampled);
}

static inline lanes_mask group_tick(const group_step *g, lanes_mask which, group_state *s, int32_t position,
                                    const group_inputs *in, lanes until, bool whole)
{
    const bool partial = s->partial[0];
    const group_inputs *acting = in;
    group_inputs mean;
    if (position == 0 && !partial) group_sample(g, which, s, in);
    s->active = s->line[position < g->before ? 0 : 1];
    lanes origin = lanes_set(0.0);
    if (partial) {
        which = group_split(g, which, s, acting);
        origin = s->origin;
    }
    if (partial || !whole) {
        group_extend(s, until, acting);
        s->partial[0] = 1;
        mean = group_mean(s);
        acting = &mean;
    }
    if (whole) {
        s->partial[0] = 0;
        return group_finish(g, which, s, &s->plant, acting, until - origin);
    }
    s->tentative = s->plant;
    return group_finish(g, which, s, &s->tentative, acting, until - origin);
}

/* Advance the lanes of `which` (at least one) to the step's end, as far as they move together; returns those that reached
 * it. The values of other lanes in `s` and `out` have no meaning. */
static inline lanes_mask group_move(const group_step *g, unsigned which, group_state *s, const group_inputs *in,
                                    lanes *out)
{
    const int lead = __builtin_ctz(which);
    /* As in core_move the next sample is not located: at the slack's very edge the two ways may round differently. */
    const lanes next = lanes_set((double)(s->period[lead] + 1)), none = lanes_set(0.0);
    const lanes_mask near = lanes_less_equal(lanes_fabs(lanes_set(g->end) - next * g->plan.period), g->plan.slack);
    const lanes at[3] = {lanes_where(near, next, g->at[0]), lanes_where(near, none, g->at[1]),
                         lanes_where(near, none, g->at[2])};
    const lanes first = group_lane(&at[0], lead), second = group_lane(&at[1], lead);
    lanes_mask moving = lanes_both(lanes_of_bits(which), lanes_both(lanes_equal(at[0], first),
                                                                   lanes_equal(at[1], second)));
    const double periods = *(const double *)&first;
    int32_t position = (int32_t)*(const double *)&second;
    int64_t here = s->period[lead];
    int32_t there = s->position[lead];
    s->partial[0] = s->partial[lead];
    if (!((periods - (double)here) * g->ticks <= CORE_MOST_TICKS)) return lanes_of_bits(0);
    int64_t period = (int64_t)(periods > -1.0 ? periods : -1.0);
    lanes rest = at[2];
    if (period < here || (period == here && position <= there)) { /* time never goes back */
        const lanes covered = s->partial[0] ? s->covered : lanes_set(0.0);
        const bool behind = period < here || position < there;
        period = here;
        position = there;
        rest = behind ? covered : lanes_where(lanes_less(rest, covered), covered, rest);
    }
    for (int64_t left = (period - here) * g->ticks + (position - there); lanes_any(moving) && left > 0; --left) {
        moving = group_tick(g, moving, s, there, in, there < g->before ? g->plan.h_before : g->plan.h_after, true);
        if (++there == g->ticks) {
            there = 0;
            ++here;
        }
    }
    s->tentative = s->plant;
    const lanes_mask inside = lanes_both(moving, lanes_greater(rest, lanes_set(0.0)));
    if (lanes_any(inside)) {
        moving = inside;
        moving = group_tick(g, moving, s, there, in, rest, false);
    }
    for (int l = 0; l < LANES; ++l) {
        s->period[l] = here;
        s->position[l] = there;
        s->partial[l] = s->partial[0];
    }
    group_outputs(g, lanes_bits(moving), s, in, out);
    const lanes sum = (group_sum(s->sampled, CORE_SAMPLED) + group_sum(s->tentative.x, CORE_PLANT))
                      + group_sum(out, MODEL_OUTPUTS);
    return lanes_both(moving, lanes_equal(sum - sum, lanes_set(0.0)));
}

#endif
