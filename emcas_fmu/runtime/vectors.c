/* Many actuators as a library for the Python API, LANES at a time. */
#include "kernel.h"
#include "vector.h"
#include "vector_kernel.h"

#include "core.h"
#include "parameter_checks.h"
#include "tables.h"

enum { PLAN = sizeof(core_schedule) / sizeof(lanes), INPUTS = sizeof(core_inputs) / sizeof(lanes) };

/* Parameters of actuators and, behind them, the constants computed from these. */
enum { GROUP_VALUES = MODEL_PARAMETERS + KERNEL_CONSTANTS };

typedef struct {
    lanes values[GROUP_VALUES];
} group_parameters;

/* The time that each lane has reached, as in core_state. */
typedef struct {
    int64_t period[LANES];
    int32_t position[LANES], partial[LANES];
} group_times;

/* `motion_loads` are those of `motion`; `common_motion` is its number if all groups have the same motion, else 0. */
typedef struct {
    uint64_t common_motion;
    lanes motion[MODEL_MOTION], motion_loads[CORE_MOTION_LOADS];
    bool apart;        /* the lanes may have reached different times: `times`; otherwise their time is that of the state */
    group_times times;
    core_state state; /* with a line as long as the longest of the batch */
} group;

/* A step of a group to `end` [s]. */
typedef struct {
    const lanes *p, *c;
    core_schedule plan;
    double end;
    size_t line;           /* length of the longest line of a lane */
    lanes_mask together;   /* lanes whose schedule has the same numbers as that of lane 0 */
} group_step;

/* Many actuators, in groups of LANES. `order` lists the actuators of the groups; the last one is repeated to fill a group.
 * The values of an actuator are its parameters and the constants computed from them. `common` are those of one actuator;
 * `indices` are the indices of those that differ between actuators, and `varying` has a vector for each of these, group
 * after group. */
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

/* The number of values of an actuator, and the number of values of its schedule. */
API size_t batch_values(size_t *schedule)
{
    *schedule = PLAN;
    return GROUP_VALUES;
}

/* Mark the values that steps, samples and outputs read; the others are needed only to compute these. */
API void batch_reads(unsigned char *reads)
{
    memset(reads, 1, GROUP_VALUES);
    memcpy(reads, VECTOR_READS, sizeof VECTOR_READS);
}

/* Bytes of a group whose delay buffers have `line` values at most. */
API size_t batch_group_size(size_t line)
{
    return offsetof(group, state.line) + line * sizeof(lanes);
}

/* Compute the values and schedules of actuators from their `parameters`, `apart` [doubles] from one to the next. The period
 * of an actuator whose parameters break a limit or rule is NaN. */
API void batch_prepare(size_t count, const double *parameters, size_t apart, double *values, double *schedules)
{
    for (size_t i = 0; i < count; ++i) {
        const double *p = parameters + i * apart;
        double *to = values + i * GROUP_VALUES;
        schedules[i * PLAN] = NAN;
        if (!rules_hold(p)) continue;
        memcpy(to, p, MODEL_PARAMETERS * sizeof *p);
        kernel_prepare(p, to + MODEL_PARAMETERS);
        kernel_schedule(p, to + MODEL_PARAMETERS, schedules + i * PLAN);
    }
}

static group_step prepared(const group_parameters *of, double end)
{
    group_step g = {.p = of->values, .c = of->values + MODEL_PARAMETERS, .end = end, .together = EVERY_LANE};
    g.plan = core_scheduled(g.p, g.c);
    const lanes counts[] = {g.plan.before, g.plan.after, g.plan.samples, g.plan.late_commands};
    for (int i = 0; i < 4; ++i) g.together = lanes_both(g.together, lanes_alike(counts[i], 0));
    for (int l = 0; l < LANES; ++l) {
        const size_t line = (size_t)lanes_of(g.plan.samples + g.plan.late_commands, l) + 2;
        if (line > g.line) g.line = line;
    }
    return g;
}

static double *lane_at(lanes *x, int lane)
{
    return (double *)x + lane;
}

static void to_lane(lanes *to, int lane, const double *from, size_t count)
{
    for (size_t i = 0; i < count; ++i) *lane_at(&to[i], lane) = from[i];
}

/* Copy one lane, and copy one lane to all. */
static void copy_lane(lanes *to, int lane, const lanes *from, size_t count)
{
    for (size_t i = 0; i < count; ++i) *lane_at(&to[i], lane) = lanes_of(from[i], lane);
}

static void spread_lane(lanes *to, int lane, const lanes *from, size_t count)
{
    for (size_t i = 0; i < count; ++i) to[i] = lanes_set(lanes_of(from[i], lane));
}

/* Apply one of both to a state, but for the time, with `line` values of the delay buffer. */
static void each_value(void (*copy)(lanes *, int, const lanes *, size_t), core_state *to, int lane, const core_state *from,
                       size_t line)
{
    copy((lanes *)&to->part, lane, (const lanes *)&from->part, sizeof to->part / sizeof(lanes));
    copy(to->sampled, lane, from->sampled, (offsetof(core_state, line) - offsetof(core_state, sampled)) / sizeof(lanes) + line);
}

static void set_time(group_times *times, int lane, const core_state *s)
{
    times->period[lane] = s->period;
    times->position[lane] = s->position;
    times->partial[lane] = s->partial;
}

static void get_time(core_state *s, const group_times *times, int lane)
{
    s->period = times->period[lane];
    s->position = times->position[lane];
    s->partial = times->partial[lane];
}

/* The lanes that have reached the same time as `lane`. */
static unsigned beside(const group_times *t, int lane)
{
    unsigned with = 0;
    for (int l = 0; l < LANES; ++l)
        with |= (unsigned)(t->period[l] == t->period[lane] && t->position[l] == t->position[lane]
                           && t->partial[l] == t->partial[lane]) << l;
    return with;
}

/* The lane of `which` (at least one) that has reached the latest time. */
static int latest(const group_times *t, unsigned which)
{
    int lead = __builtin_ctz(which);
    for (int l = lead + 1; l < LANES; ++l)
        if (which >> l & 1u && (t->period[l] > t->period[lead]
                                || (t->period[l] == t->period[lead] && t->position[l] > t->position[lead]))) lead = l;
    return lead;
}

/* Move one lane from the state `before`, at its time, as if all lanes were like it. */
static core_result alone(const group_step *g, const core_state *before, group *at, int lane, const core_inputs *in,
                         lanes *out)
{
    lanes values[GROUP_VALUES], outputs[MODEL_OUTPUTS];
    core_state state;
    core_inputs inputs;
    spread_lane(values, lane, g->p, GROUP_VALUES);
    spread_lane((lanes *)&inputs, lane, (const lanes *)in, INPUTS);
    each_value(spread_lane, &state, lane, before, g->line);
    get_time(&state, &at->times, lane);
    const core_result result = core_run(values, values + MODEL_PARAMETERS, &state, g->end, &inputs, NULL, outputs);
    each_value(copy_lane, &at->state, lane, &state, g->line);
    set_time(&at->times, lane, &state);
    copy_lane(out, lane, outputs, MODEL_OUTPUTS);
    return result;
}

/* Advance a group, each lane all or nothing; returns the lanes that did not get there, with their reasons in `result`. */
static unsigned move(const group_step *g, group *at, const core_inputs *in, lanes *out, core_result *result)
{
    core_state before, *s = &at->state;
    core_result why;
    unsigned which = lanes_bits(g->together), stopped = 0;
    if (at->apart) {
        const int lead = latest(&at->times, which);
        which &= beside(&at->times, lead);
        get_time(s, &at->times, lead);
    }
    core_keep(s, &before, g->line, s->partial || at->apart);
    which = lanes_bits(core_move(g->p, g->c, lanes_of_bits(which), s, &g->plan, g->end, in, NULL, out, &why));
    if (which == LANES_ALL) {
        at->apart = false;
        return 0;
    }
    for (int l = 0; l < LANES; ++l) {
        if (!at->apart) set_time(&at->times, l, &before);
        if (which >> l & 1u) {
            set_time(&at->times, l, s);
            continue;
        }
        result[l] = alone(g, &before, at, l, in, out);
        stopped |= (unsigned)(result[l] != CORE_DONE) << l;
    }
    at->apart = beside(&at->times, 0) != LANES_ALL;
    get_time(s, &at->times, 0);
    return stopped;
}

/* Compute the motion loads of a group if the vehicle's motion has changed. A motion that all groups have in common has a
 * number above 0, which changes with it. */
static void update_motion_loads(group *at, const group_step *g, const lanes *motion, uint64_t common)
{
    if (common && at->common_motion == common) return;
    lanes_mask same = lanes_of_bits(LANES_ALL);
    for (int i = 0; i < MODEL_MOTION; ++i) same = lanes_both(same, lanes_same(at->motion[i], motion[i]));
    at->common_motion = common;
    if (lanes_bits(same) == LANES_ALL) return;
    memcpy(at->motion, motion, sizeof at->motion);
    core_motion_loads(g->p, g->c, motion, at->motion_loads);
}

static void prefetch_from(const void *first, const void *last)
{
    for (const char *line = first; line < (const char *)last; line += 64) __builtin_prefetch(line);
}

/* Fetch from memory what a step of a group needs: everything but the part of a tick. */
static void prefetch(const group *at, size_t bytes)
{
    prefetch_from(at->motion_loads, &at->state);
    prefetch_from(&at->state.period, (const char *)at + bytes);
}

static void fill(group_parameters *of, const double *common)
{
    for (int i = 0; i < GROUP_VALUES; ++i) of->values[i] = lanes_set(common[i]);
}

static void vary(group_parameters *of, const batch *b, size_t k)
{
    const lanes *from = b->varying + k * b->indices_count;
    for (size_t i = 0; i < b->indices_count; ++i) of->values[b->indices[i]] = from[i];
}

static void start(group *at, const group_parameters *of, size_t size)
{
    memset(at, 0, size);
    at->motion[0] = lanes_set(NAN);
    core_start(of->values, of->values + MODEL_PARAMETERS, &at->state);
}

/* Put groups first to last - 1 at rest at their start. */
API void batch_start(const batch *b, size_t first, size_t last)
{
    group_parameters of;
    fill(&of, b->common);
    for (size_t k = first; k < last; ++k) {
        vary(&of, b, k);
        start((group *)(b->groups + k * b->group_size), &of, b->group_size);
    }
}

/* Advance groups first to last - 1 to `end` [s], with inputs, outputs and results as in actuators_run of batch.c. `motion`
 * is the number of the vehicle's motion. Returns how many actuators did not get there. */
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
    group_parameters of;
    group_step g = {.p = NULL};
    fill(&of, b->common);
    for (size_t k = first; k < last; ++k) {
        group *at = (group *)(b->groups + k * b->group_size);
        if (k + 1 < last) prefetch((const group *)(b->groups + (k + 1) * b->group_size), b->group_size);
        vary(&of, b, k);
        if (!g.p || !b->same_schedule) g = prepared(&of, end);
        const size_t *actuator = b->order + k * LANES;
        const size_t full = b->count - k * LANES < LANES ? b->count - k * LANES : LANES;
        const bool beside = b->in_order && full == LANES;
        for (int j = 0; j < count; ++j) {
            const int i = varying[j];
            if (beside && stride[i] == 1) row[i] = lanes_load(columns[i] + actuator[0]);
            else
                for (int l = 0; l < LANES; ++l) *lane_at(&row[i], l) = columns[i][(ptrdiff_t)actuator[l] * stride[i]];
        }
        lanes outputs[MODEL_OUTPUTS];
        core_inputs in;
        core_result why[LANES];
        update_motion_loads(at, &g, row + INPUT_ACCELERATION_X, motion);
        core_inputs_of(row, at->motion_loads, &in);
        const unsigned stopped = move(&g, at, &in, outputs, why);
        if (beside && !stopped) {
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
                out[(size_t)i * out_stride + actuator[l]] = *lane_at(&outputs[i], (int)l);
        }
    }
    return failed;
}

/* Read a row of inputs of a group's runs; returns the lanes whose inputs are finite. */
static unsigned table_row(const input_column *in, const size_t *run, size_t k, lanes *row)
{
    lanes sum = lanes_set(0.0);
    for (int i = 0; i < MODEL_INPUTS; ++i) {
        const double *at = in[i].first + (ptrdiff_t)k * in[i].row;
        row[i] = lanes_set(*at);
        if (in[i].run)
            for (int l = 0; l < LANES; ++l) *lane_at(&row[i], l) = at[(ptrdiff_t)run[l] * in[i].run];
        sum = sum + (row[i] - row[i]);
    }
    return lanes_bits(lanes_equal(sum, lanes_set(0.0)));
}

/* actuators_simulate for the lanes `which` of a group, which are the runs `run`. A run that does not stay with the others,
 * or whose equations cannot be followed, is left RUN_APART. */
static void simulate(const group_parameters *of, unsigned which, const size_t *run, size_t points, double step,
                     size_t held, const input_column *in, const double *spring, size_t angle, const output_column *out,
                     size_t columns, int64_t *reached, int *result)
{
    group at;
    core_inputs inputs;
    lanes row[MODEL_INPUTS], now[MODEL_OUTPUTS], stiffness = lanes_set(0.0);
    for (int l = 0; spring && l < LANES; ++l) *lane_at(&stiffness, l) = spring[run[l]];
    core_result why;
    const group_step g = prepared(of, 0.0);
    start(&at, of, sizeof at);
    which &= lanes_bits(g.together);
    for (size_t k = 0; which && k < points; ++k) {
        if (k) which = lanes_bits(core_move(g.p, g.c, lanes_of_bits(which), &at.state, &g.plan, (double)k * step, &inputs,
                                            NULL, now, &why));
        if (k % held == 0) {
            which &= table_row(in, run, k / held, row);
            update_motion_loads(&at, &g, row + INPUT_ACCELERATION_X, 0);
            core_inputs_of(row, at.motion_loads, &inputs);
        }
        if (k == 0) core_outputs(g.p, g.c, &at.state, &g.plan, &inputs, now);
        if (spring && k % held == 0) inputs.loads[0] = inputs.loads[0] - stiffness * now[angle];
        for (size_t j = 0; j < columns; ++j) {
            if (!kept_at(&out[j], k)) continue;
            double *to = value_at(&out[j], 0, k);
            for (int l = 0; l < LANES; ++l)
                if (which >> l & 1u) to[(ptrdiff_t)run[l] * out[j].run] = *lane_at(&now[out[j].index], l);
        }
    }
    for (int l = 0; l < LANES; ++l) {
        if (!(which >> l & 1u)) continue;
        reached[run[l]] = (int64_t)points;
        result[run[l]] = CORE_DONE;
    }
}

/* actuators_simulate of batch.c for actuators with `values`, `apart` [doubles] from one to the next. In the `order` of runs
 * neighbours have like schedules. Runs with the result RUN_APART have to be simulated alone. */
API void batch_simulate(size_t count, const size_t *order, const double *values, size_t apart, size_t points, double step,
                        size_t held, const input_column *in, const double *spring, size_t angle,
                        const output_column *out, size_t columns, int64_t *reached, int *result)
{
    group_parameters of;
    fill(&of, values);
    for (size_t first = 0; first < count; first += LANES) {
        size_t run[LANES];
        const size_t full = count - first < LANES ? count - first : LANES;
        for (size_t l = 0; l < LANES; ++l) run[l] = order[first + (l < full ? l : full - 1)];
        for (size_t l = 0; apart && l < LANES; ++l) to_lane(of.values, (int)l, values + run[l] * apart, GROUP_VALUES);
        for (size_t l = 0; l < full; ++l) result[run[l]] = RUN_APART;
        simulate(&of, (1u << full) - 1u, run, points, step, held, in, spring, angle, out, columns, reached, result);
    }
}
