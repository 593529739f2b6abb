/* Many actuators as a library for the Python API, LANES at a time. */
#include "vector_core.h"
#include "parameter_checks.h"
#include "tables.h"

enum { PLAN = sizeof(core_schedule) / sizeof(double) };

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
        core_schedule plan = {.period = NAN};
        if (rules_hold(p)) {
            memcpy(to, p, MODEL_PARAMETERS * sizeof *p);
            kernel_prepare(p, to + MODEL_PARAMETERS);
            plan = core_scheduled(p, to + MODEL_PARAMETERS);
        }
        memcpy(schedules + i * PLAN, &plan, sizeof plan);
    }
}

/* The step of a group to `end` [s]. Lanes with other numbers of ticks or delayed samples are not `together` with lane 0. */
static group_step prepared(const group_parameters *of, double end)
{
    group_step g = {.p = of->values, .c = of->values + MODEL_PARAMETERS, .end = end};
    vector_schedule(LANES_ALL, g.p, g.c, (lanes *)&g.plan);
    vector_locate(LANES_ALL, g.p, g.c, lanes_set(end), g.at);
    const double before = *group_at(&g.plan.before, 0), after = *group_at(&g.plan.after, 0);
    g.before = (int32_t)before;
    g.ticks = (int32_t)(before + after);
    g.values = (size_t)*group_at(&g.plan.samples, 0) + 2;
    g.late = (size_t)*group_at(&g.plan.late_commands, 0);
    const lanes *const counts[] = {&g.plan.before, &g.plan.after, &g.plan.samples, &g.plan.late_commands};
    lanes_mask same = lanes_of_bits(LANES_ALL);
    for (int i = 0; i < 4; ++i) same = lanes_both(same, lanes_equal(*counts[i], group_lane(counts[i], 0)));
    g.together = lanes_bits(same);
    g.line = 0;
    for (int l = 0; l < LANES; ++l) {
        const size_t line = (size_t)*group_at(&g.plan.samples, l) + 2 + (size_t)*group_at(&g.plan.late_commands, l);
        if (line > g.line) g.line = line;
    }
    return g;
}

/* core_start for every lane. */
static void start(group *at, const group_step *g)
{
    memset(at, 0, batch_group_size(g->line));
    at->motion[0] = lanes_set(NAN);
    group_state *s = &at->state;
    const size_t limited = CORE_CONTROLLER + 1;
    lanes out[CORE_PLANT + CORE_SAMPLED - 1];
    vector_initial(LANES_ALL, g->p, g->c, out);
    memcpy(s->plant.x, out, sizeof s->plant.x);
    s->tentative = s->plant;
    for (size_t i = 0; i < limited; ++i) s->sampled[i] = out[CORE_PLANT + i];
    for (size_t i = limited + 1; i < CORE_SAMPLED; ++i) s->sampled[i] = out[CORE_PLANT + i - 1];
}

static void to_lane(lanes *to, int lane, const double *from, size_t count)
{
    for (size_t i = 0; i < count; ++i) *group_at(&to[i], lane) = from[i];
}

static void of_lane(double *to, int lane, const lanes *from, size_t count)
{
    for (size_t i = 0; i < count; ++i) to[i] = ((const double *)&from[i])[lane];
}

enum { INPUTS = sizeof(core_inputs) / sizeof(double) };

static void take_out(const group_state *from, int lane, core_state *s, size_t line)
{
    s->period = from->period[lane];
    s->position = from->position[lane];
    s->partial = from->partial[lane];
    of_lane(s->sampled, lane, from->sampled, CORE_SAMPLED);
    of_lane(&s->active, lane, &from->active, 1);
    of_lane(s->plant.x, lane, from->plant.x, CORE_PLANT);
    of_lane(s->tentative.x, lane, from->tentative.x, CORE_PLANT);
    of_lane(&s->part.origin, lane, &from->origin, 1);
    of_lane(&s->part.covered, lane, &from->covered, 1);
    of_lane(s->part.loads, lane, from->loads, CORE_LOADS);
    of_lane((double *)&s->part.first, lane, (const lanes *)&from->first, INPUTS);
    of_lane(s->line, lane, from->line, line);
}

static void put_back(const core_state *s, group_state *to, int lane, size_t line)
{
    to->period[lane] = s->period;
    to->position[lane] = s->position;
    to->partial[lane] = s->partial;
    to_lane(to->sampled, lane, s->sampled, CORE_SAMPLED);
    to_lane(&to->active, lane, &s->active, 1);
    to_lane(to->plant.x, lane, s->plant.x, CORE_PLANT);
    to_lane(to->tentative.x, lane, s->tentative.x, CORE_PLANT);
    to_lane(&to->origin, lane, &s->part.origin, 1);
    to_lane(&to->covered, lane, &s->part.covered, 1);
    to_lane(to->loads, lane, s->part.loads, CORE_LOADS);
    to_lane((lanes *)&to->first, lane, (const double *)&s->part.first, INPUTS);
    to_lane(to->line, lane, s->line, line);
}

/* core_run for one lane from the state `before`; its state and outputs are written to that lane of `s` and `out`. */
static core_result alone(const group_step *g, const group_state *before, group_state *s, int lane,
                         const group_inputs *in, lanes *out)
{
    double p[MODEL_PARAMETERS], c[KERNEL_CONSTANTS], outputs[MODEL_OUTPUTS];
    core_state state;
    core_inputs inputs;
    of_lane(p, lane, g->p, MODEL_PARAMETERS);
    of_lane(c, lane, g->c, KERNEL_CONSTANTS);
    of_lane((double *)&inputs, lane, (const lanes *)in, INPUTS);
    take_out(before, lane, &state, g->line);
    const core_result result = core_run(p, c, &state, g->end, &inputs, NULL, outputs);
    put_back(&state, s, lane, g->line);
    if (result == CORE_DONE) to_lane(out, lane, outputs, MODEL_OUTPUTS);
    return result;
}

/* Copy a group's state; the part of a tick only if a lane is inside a tick. */
static void keep(const group_state *s, group_state *to, size_t line)
{
    enum { ALWAYS = (offsetof(group_state, line) - offsetof(group_state, sampled)) / sizeof(lanes) };
    int32_t partial = 0;
    for (int l = 0; l < LANES; ++l) partial |= s->partial[l];
    if (partial) memcpy(to, s, offsetof(group_state, period));
    memcpy(to->period, s->period, sizeof s->period);
    memcpy(to->position, s->position, sizeof s->position);
    memcpy(to->partial, s->partial, sizeof s->partial);
    const lanes *from = s->sampled;
    lanes *copy = to->sampled;
#pragma GCC unroll 64
    for (int i = 0; i < ALWAYS; ++i) copy[i] = from[i];
    for (size_t i = 0; i < line; ++i) to->line[i] = s->line[i];
}

/* Advance a group, each lane all or nothing; returns the lanes that did not get there, with their reasons in `result`. */
static unsigned move(const group_step *g, group_state *s, const group_inputs *in, lanes *out, core_result *result)
{
    group_state before;
    keep(s, &before, g->line);
    const unsigned done = lanes_bits(group_move(g, group_together(s, g->together), s, in, out));
    unsigned stopped = 0;
    for (int l = 0; done != LANES_ALL && l < LANES; ++l) {
        if (done >> l & 1u) continue;
        result[l] = alone(g, &before, s, l, in, out);
        stopped |= (unsigned)(result[l] != CORE_DONE) << l;
    }
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
    vector_motion_loads(LANES_ALL, g->p, g->c, MODEL_MOTION_OF(motion), at->motion_loads);
}

/* A group's inputs from a row of the interface's. */
static void inputs_of(const group *at, const lanes *row, group_inputs *in)
{
    in->command = row[INPUT_FIN_COMMAND];
    in->loads[0] = row[INPUT_AERO_TORQUE];
    for (int i = 0; i < CORE_MOTION_LOADS; ++i) in->loads[i + 1] = at->motion_loads[i];
    in->supply = lanes_set(0.0);
#if MODEL_SUPPLY >= 0
    in->supply = row[MODEL_SUPPLY];
#endif
    in->enable = row[INPUT_ENABLE];
    for (int i = 0; i < CORE_FURTHER; ++i) in->further[i] = row[MODEL_INPUTS - CORE_FURTHER + i];
    in->further[CORE_FURTHER] = lanes_set(0.0);
}

static void prefetch_from(const void *first, const void *last)
{
    for (const char *line = first; line < (const char *)last; line += 64) __builtin_prefetch(line);
}

/* Fetch from memory what a step of a group needs: everything but the part of a tick. */
static void prefetch(const group *at, size_t bytes)
{
    prefetch_from(at->motion_loads, &at->state);
    prefetch_from(at->state.period, (const char *)at + bytes);
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

/* Put groups first to last - 1 at rest at their start. */
API void batch_start(const batch *b, size_t first, size_t last)
{
    group_parameters of;
    fill(&of, b->common);
    for (size_t k = first; k < last; ++k) {
        vary(&of, b, k);
        const group_step g = prepared(&of, 0.0);
        start((group *)(b->groups + k * b->group_size), &g);
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
                for (int l = 0; l < LANES; ++l) *group_at(&row[i], l) = columns[i][(ptrdiff_t)actuator[l] * stride[i]];
        }
        lanes outputs[MODEL_OUTPUTS];
        group_inputs in;
        core_result why[LANES];
        update_motion_loads(at, &g, row + INPUT_ACCELERATION_X, motion);
        inputs_of(at, row, &in);
        const unsigned stopped = move(&g, &at->state, &in, outputs, why);
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
                out[(size_t)i * out_stride + actuator[l]] = *group_at(&outputs[i], (int)l);
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
            for (int l = 0; l < LANES; ++l) *group_at(&row[i], l) = at[(ptrdiff_t)run[l] * in[i].run];
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
    group_inputs inputs;
    lanes row[MODEL_INPUTS], now[MODEL_OUTPUTS], stiffness = lanes_set(0.0);
    for (int l = 0; spring && l < LANES; ++l) *group_at(&stiffness, l) = spring[run[l]];
    group_step g = prepared(of, 0.0);
    start(&at, &g);
    which &= g.together;
    for (size_t k = 0; which && k < points; ++k) {
        if (k) {
            g.end = (double)k * step;
            vector_locate(which, g.p, g.c, lanes_set(g.end), g.at);
            which &= lanes_bits(group_move(&g, which, &at.state, &inputs, now));
        }
        if (k % held == 0) {
            which &= table_row(in, run, k / held, row);
            update_motion_loads(&at, &g, row + INPUT_ACCELERATION_X, 0);
            inputs_of(&at, row, &inputs);
        }
        if (k == 0) group_outputs(&g, which, &at.state, &inputs, now);
        if (spring && k % held == 0) inputs.loads[0] = inputs.loads[0] - stiffness * now[angle];
        for (size_t j = 0; j < columns; ++j) {
            if (!kept_at(&out[j], k)) continue;
            double *to = value_at(&out[j], 0, k);
            for (int l = 0; l < LANES; ++l)
                if (which >> l & 1u) to[(ptrdiff_t)run[l] * out[j].run] = *group_at(&now[out[j].index], l);
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
