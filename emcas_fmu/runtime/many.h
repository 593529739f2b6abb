/* Many actuators as a library for the Python API, LANES at a time. */
#ifndef EMCAS_MANY_H
#define EMCAS_MANY_H

#include "core.h"
#include "parameter_checks.h"

#if defined _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

enum {
    VALUES = MODEL_PARAMETERS + KERNEL_CONSTANTS, /* parameters of an actuator and, behind them, their constants */
    PLAN = sizeof(core_schedule) / sizeof(lanes),
    INPUTS = sizeof(core_inputs) / sizeof(lanes)
};

/* LANES actuators. `motion_loads` are computed from `motion`; `common_motion` is the number of a motion that all groups
 * share, otherwise 0. The times of the lanes are `times` if they are `apart`, otherwise that of the state. */
typedef struct {
    lanes motion[MODEL_MOTION];
    core_time times[LANES];
    uint64_t common_motion; /* usual steps need only the values from here on */
    bool apart;
    lanes motion_loads[CORE_MOTION_LOADS];
    core_state state; /* with a delay buffer as long as the longest of the batch */
} group;

/* The step of a group to `end` [s]. */
typedef struct {
    const lanes *p, *c;
    core_schedule plan;
    double end;
    size_t line;         /* length of the longest delay buffer */
    lanes_mask together; /* lanes whose schedule has the same numbers as that of lane 0 */
} group_step;

/* Many actuators, in groups of LANES. `order` lists the actuators of the groups; the last one is repeated to fill a
 * group. `common` are the values of one actuator; `indices` are the indices of the values that differ between
 * actuators, and `varying` has lanes for each of these values, group after group. */
typedef struct {
    size_t count;
    const size_t *order;
    const double *common;
    size_t indices_count;
    const size_t *indices;
    const lanes *varying;
    char *groups;
    size_t group_size;
    int same_schedule, in_order; /* all actuators have the same schedule; `order` is the columns' order */
} batch;

API int batch_lanes(void)
{
    return LANES;
}

/* Return the number of values of an actuator; set the number of values of its schedule. */
API size_t batch_values(size_t *schedule)
{
    *schedule = PLAN;
    return VALUES;
}

/* Mark the values that steps, samples and outputs read; other values are needed only to compute the marked ones. */
API void batch_reads(unsigned char *reads)
{
    memset(reads, 1, VALUES);
#ifdef EMCAS_VECTOR_H
    memcpy(reads, VECTOR_READS, sizeof VECTOR_READS);
#endif
}

/* Return the size [bytes] of a group whose delay buffers have `line` values at most. */
API size_t batch_group_size(size_t line)
{
    return offsetof(group, state.line) + line * sizeof(lanes);
}

/* Compute the values and schedules of actuators from their `parameters`, which are `stride` [doubles] apart. The sample
 * time of an actuator whose parameters break a limit or rule is NaN; its other values are not set. */
API void batch_prepare(size_t count, const double *parameters, size_t stride, double *values, double *schedules)
{
    for (size_t i = 0; i < count; ++i) {
        const double *p = parameters + i * stride;
        double *to = values + i * VALUES;
        schedules[i * PLAN] = NAN;
        if (!rules_hold(p)) continue;
        memcpy(to, p, MODEL_PARAMETERS * sizeof *p);
        kernel_prepare(p, to + MODEL_PARAMETERS);
        kernel_schedule(p, to + MODEL_PARAMETERS, schedules + i * PLAN);
    }
}

static group_step prepared(const lanes *values, double end)
{
    group_step g = {.p = values, .c = values + MODEL_PARAMETERS, .end = end, .together = EVERY_LANE};
    g.plan = core_scheduled(g.p, g.c);
    const lanes counts[] = {g.plan.before, g.plan.after, g.plan.delay_samples, g.plan.late_commands};
    for (int i = 0; i < 4; ++i) g.together = lanes_both(g.together, lanes_alike(counts[i], 0));
    for (int l = 0; l < LANES; ++l) {
        const size_t line = (size_t)lanes_of(g.plan.delay_samples + g.plan.late_commands, l) + 2;
        if (line > g.line) g.line = line;
    }
    return g;
}

static void set_lane(lanes *to, int lane, double value)
{
    ((double *)to)[lane] = value;
}

static void copy_lane(lanes *to, int lane, const lanes *from, size_t count)
{
    for (size_t i = 0; i < count; ++i) set_lane(&to[i], lane, lanes_of(from[i], lane));
}

/* Copy one lane to all. */
static void spread_lane(lanes *to, int lane, const lanes *from, size_t count)
{
    for (size_t i = 0; i < count; ++i) to[i] = lanes_set(lanes_of(from[i], lane));
}

/* Copy a state except its time by `copy`: `line` values of the delay buffer, and the part if `partial`. */
static void copy_state(void (*copy)(lanes *, int, const lanes *, size_t), core_state *to, int lane,
                       const core_state *from, size_t line, bool partial)
{
    enum { ALWAYS = (offsetof(core_state, line) - offsetof(core_state, sampled)) / sizeof(lanes) };
    if (partial) copy((lanes *)&to->part, lane, (const lanes *)&from->part, sizeof to->part / sizeof(lanes));
    copy(to->sampled, lane, from->sampled, ALWAYS + line);
}

/* Return the lanes that have reached the same time as `lane`. */
static unsigned beside(const core_time *t, int lane)
{
    unsigned with = 0;
    for (int l = 0; l < LANES; ++l)
        with |= (unsigned)(memcmp(&t[l], &t[lane], sizeof *t) == 0) << l;
    return with;
}

/* Return the lane of `which` (at least one) that has reached the latest time. */
static int latest(const core_time *t, unsigned which)
{
    int lead = __builtin_ctz(which);
    for (int l = lead + 1; l < LANES; ++l)
        if (which >> l & 1u && (t[l].period > t[lead].period
                                || (t[l].period == t[lead].period && t[l].position > t[lead].position))) lead = l;
    return lead;
}

/* Advance one lane from the state `before` at the lane's time, as if all lanes were equal to it. */
static core_result alone(const group_step *g, const core_state *before, group *at, int lane, const core_inputs *in,
                         lanes *out)
{
    lanes values[VALUES], outputs[MODEL_OUTPUTS];
    core_state state;
    core_inputs inputs;
    spread_lane(values, lane, g->p, VALUES);
    spread_lane((lanes *)&inputs, lane, (const lanes *)in, INPUTS);
    state.time = at->times[lane];
    copy_state(spread_lane, &state, lane, before, g->line, state.time.partial);
    const core_result result = core_run(values, values + MODEL_PARAMETERS, &state, g->end, &inputs, NULL, outputs);
    copy_state(copy_lane, &at->state, lane, &state, g->line, state.time.partial);
    at->times[lane] = state.time;
    copy_lane(out, lane, outputs, MODEL_OUTPUTS);
    return result;
}

/* Advance a group, each lane all or nothing; returns the lanes that did not reach the end, and sets their `result`. */
static unsigned move(const group_step *g, group *at, const core_inputs *in, lanes *out, core_result *result)
{
    core_state before, *s = &at->state;
    core_result why;
    const bool apart = LANES > 1 && at->apart;
    unsigned which = lanes_bits(g->together), stopped = 0;
    if (apart) {
        const int lead = latest(at->times, which);
        which &= beside(at->times, lead);
        s->time = at->times[lead];
    }
    core_keep(s, &before, g->line, apart || s->time.partial);
    which = lanes_bits(core_move(g->p, g->c, lanes_of_bits(which), s, &g->plan, g->end, in, NULL, out, &why));
    if (which == LANES_ALL) {
        if (apart) at->apart = false;
        return 0;
    }
    for (int l = 0; l < LANES; ++l) {
        if (!apart) at->times[l] = before.time;
        if (which >> l & 1u) {
            at->times[l] = s->time;
            continue;
        }
        result[l] = alone(g, &before, at, l, in, out);
        stopped |= (unsigned)(result[l] != CORE_DONE) << l;
    }
    at->apart = beside(at->times, 0) != LANES_ALL;
    s->time = at->times[0];
    return stopped;
}

/* Compute the motion loads of a group if the vehicle's motion has changed. `common` is the number
 * of a motion that all groups share, which changes with the motion; otherwise 0. */
static void update_motion_loads(group *at, const group_step *g, const lanes *motion, uint64_t common)
{
    if (common && at->common_motion == common) return;
    lanes_mask same = EVERY_LANE;
    for (int i = 0; i < MODEL_MOTION; ++i) same = lanes_both(same, lanes_same(at->motion[i], motion[i]));
    at->common_motion = common;
    if (lanes_every(same)) return;
    memcpy(at->motion, motion, sizeof at->motion);
    core_motion_loads(g->p, g->c, motion, at->motion_loads);
}

static void prefetch_from(const void *first, const void *last)
{
    for (const char *line = first; line < (const char *)last; line += 64) __builtin_prefetch(line);
}

/* Fetch from memory the values that a usual step of a group needs. */
static void prefetch(const group *at, size_t bytes)
{
    prefetch_from(&at->common_motion, &at->state);
    prefetch_from(&at->state.time, (const char *)at + bytes);
}

static void fill(lanes *values, const double *common)
{
    for (int i = 0; i < VALUES; ++i) values[i] = lanes_set(common[i]);
}

/* Return the values of a group; they are stored in `values` unless all of them differ between actuators. */
static const lanes *values_of(const batch *b, size_t k, lanes *values)
{
    const lanes *from = b->varying + k * b->indices_count;
    if (b->indices_count == VALUES) return from;
    for (size_t i = 0; i < b->indices_count; ++i) values[b->indices[i]] = from[i];
    return values;
}

static void start(group *at, const lanes *values, size_t size)
{
    memset(at, 0, size);
    at->motion[0] = lanes_set(NAN); /* differs from the first motion */
    core_start(values, values + MODEL_PARAMETERS, &at->state);
}

/* Set groups first to last - 1 at rest at their start. */
API void batch_start(const batch *b, size_t first, size_t last)
{
    lanes values[VALUES];
    fill(values, b->common);
    for (size_t k = first; k < last; ++k)
        start((group *)(b->groups + k * b->group_size), values_of(b, k, values), b->group_size);
}

/* Advance groups first to last - 1 to `end` [s] with the interface's inputs held. A column of inputs has a value for
 * each actuator, `stride` [doubles] apart, or one value for all if that is 0; `motion` is the number of the vehicle's
 * motion. The columns of outputs are `out_stride` [doubles] apart. Writes a result for each actuator. Returns the
 * number of actuators that did not reach the end; their outputs are not written. */
API size_t batch_run(const batch *b, size_t first, size_t last, double end, const double *const *columns,
                     const ptrdiff_t *stride, uint64_t motion, double *out, size_t out_stride, int *result)
{
    size_t failed = 0;
    int varying[MODEL_INPUTS], count = 0;
    lanes row[MODEL_INPUTS];
    for (int i = 0; i < MODEL_INPUTS; ++i) {
        row[i] = lanes_set(*columns[i]);
        if (!stride[i]) continue;
        varying[count++] = i;
        if (i >= INPUT_ACCELERATION_X && i < INPUT_ACCELERATION_X + MODEL_MOTION) motion = 0;
    }
    lanes values[VALUES];
    group_step g = {.p = NULL};
    fill(values, b->common);
    for (size_t k = first; k < last; ++k) {
        group *at = (group *)(b->groups + k * b->group_size);
        if (k + 1 < last) prefetch((const group *)(b->groups + (k + 1) * b->group_size), b->group_size);
        const lanes *p = values_of(b, k, values);
        if (!g.p || !b->same_schedule) g = prepared(p, end);
        g.p = p;
        g.c = p + MODEL_PARAMETERS;
        const size_t *actuator = b->order + k * LANES;
        const size_t full = b->count - k * LANES < LANES ? b->count - k * LANES : LANES;
        const bool contiguous = b->in_order && full == LANES; /* in the columns */
        for (int j = 0; j < count; ++j) {
            const int i = varying[j];
            if (contiguous && stride[i] == 1) row[i] = lanes_load(columns[i] + actuator[0]);
            else
                for (int l = 0; l < LANES; ++l) set_lane(&row[i], l, columns[i][(ptrdiff_t)actuator[l] * stride[i]]);
        }
        lanes outputs[MODEL_OUTPUTS];
        core_inputs in;
        core_result why[LANES];
        update_motion_loads(at, &g, row + INPUT_ACCELERATION_X, motion);
        core_inputs_of(row, at->motion_loads, &in);
        const unsigned stopped = move(&g, at, &in, outputs, why);
        if (contiguous && !stopped) {
            for (int l = 0; l < LANES; ++l) result[actuator[0] + (size_t)l] = CORE_DONE;
            for (int i = 0; i < MODEL_OUTPUTS; ++i)
                lanes_store(out + (size_t)i * out_stride + actuator[0], outputs[i]);
            continue;
        }
        for (size_t l = 0; l < full; ++l) {
            const bool done = !(stopped >> l & 1u);
            result[actuator[l]] = done ? CORE_DONE : why[l];
            failed += !done;
            for (int i = 0; done && i < MODEL_OUTPUTS; ++i)
                out[(size_t)i * out_stride + actuator[l]] = lanes_of(outputs[i], (int)l);
        }
    }
    return failed;
}

#endif
