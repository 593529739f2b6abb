/* Many actuators as a library for the Python API, LANES at a time. */
#include "vector_core.h"
#include "parameter_checks.h"

#if defined _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

API int batch_lanes(void)
{
    return LANES;
}

API size_t batch_parameters_size(void)
{
    return sizeof(group_parameters);
}

/* Of a group whose delay lines are no longer than `line`. */
API size_t batch_group_size(size_t line)
{
    return offsetof(group, state.line) + line * sizeof(lanes);
}

/* Give a lane its parameters. Gives 0, and does nothing, if they are no set to compute with; puts the length of their
 * delay line into `line` and their schedule into `plan`. */
API int batch_bind(group_parameters *to, int lane, const double *parameters, double *plan, size_t *line)
{
    if (!rules_hold(parameters)) return 0;
    double constants[KERNEL_CONSTANTS];
    kernel_prepare(parameters, constants);
    for (int i = 0; i < MODEL_PARAMETERS; ++i) *group_at(&to->parameters[i], lane) = parameters[i];
    for (int i = 0; i < KERNEL_CONSTANTS; ++i) *group_at(&to->constants[i], lane) = constants[i];
    const core_schedule scheduled = core_scheduled(parameters, constants);
    memcpy(plan, &scheduled, sizeof scheduled);
    *line = core_line_length(&scheduled);
    return 1;
}

static group_step prepared(const group_parameters *of, double end)
{
    group_step g = {.p = of->parameters, .c = of->constants};
    vector_schedule(1u, g.p, g.c, (lanes *)&g.plan);
    const double before = *group_at(&g.plan.before, 0), after = *group_at(&g.plan.after, 0);
    g.before = (int32_t)before;
    g.ticks = (int32_t)(before + after);
    g.values = (size_t)*group_at(&g.plan.samples, 0) + 2;
    g.late = (size_t)*group_at(&g.plan.late_commands, 0);
    g.end = end;
    vector_locate(LANES_ALL, g.p, g.c, lanes_set(end), g.at);
    return g;
}

/* core_start; the delay lines of all lanes are as long. */
API void batch_start(group *at, const group_parameters *of)
{
    const group_step g = prepared(of, 0.0);
    memset(at, 0, batch_group_size(g.values + g.late));
    at->of = of;
    at->motion[0] = lanes_set(NAN);
    group_state *s = &at->state;
    const size_t limited = CORE_CONTROLLER + 1;
    lanes out[CORE_PLANT + CORE_SAMPLED - 1];
    vector_initial(LANES_ALL, g.p, g.c, out);
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

/* core_run of one lane, from `before`; its state and outputs replace what is in `s` and `out`. */
static core_result alone(const group_step *g, const group_state *before, group_state *s, int lane,
                         const group_inputs *in, lanes *out)
{
    double p[MODEL_PARAMETERS], c[KERNEL_CONSTANTS], outputs[MODEL_OUTPUTS];
    core_state state;
    core_inputs inputs;
    of_lane(p, lane, g->p, MODEL_PARAMETERS);
    of_lane(c, lane, g->c, KERNEL_CONSTANTS);
    of_lane((double *)&inputs, lane, (const lanes *)in, INPUTS);
    take_out(before, lane, &state, g->values + g->late);
    const core_result result = core_run(p, c, &state, g->end, &inputs, NULL, outputs);
    put_back(&state, s, lane, g->values + g->late);
    if (result == CORE_DONE) to_lane(out, lane, outputs, MODEL_OUTPUTS);
    return result;
}

/* Copy a group's state, without the part of a tick if no lane is inside one. */
static void keep(const group_state *s, group_state *to, size_t line)
{
    int32_t partial = 0;
    for (int l = 0; l < LANES; ++l) partial |= s->partial[l];
    if (partial) memcpy(to, s, offsetof(group_state, period));
    memcpy(to->period, s->period, sizeof s->period);
    memcpy(to->position, s->position, sizeof s->position);
    memcpy(to->partial, s->partial, sizeof s->partial);
    enum { HOT = (offsetof(group_state, line) - offsetof(group_state, sampled)) / sizeof(lanes) };
    const lanes *from = s->sampled;
    lanes *copy = to->sampled;
#pragma GCC unroll 32
    for (int i = 0; i < HOT; ++i) copy[i] = from[i];
    for (size_t i = 0; i < line; ++i) to->line[i] = s->line[i];
}

/* Move a group's lanes `which` on, all or nothing each; a result for each goes to `result`. */
static void move(const group_step *g, group_state *s, unsigned which, const group_inputs *in, lanes *out, int *result)
{
    group_state before;
    const size_t line = g->values + g->late;
    keep(s, &before, line);
    unsigned together = which & group_together(s, __builtin_ctz(which)), done = 0;
    done = lanes_bits(group_move(g, together, s, in, out));
    for (int l = 0; l < LANES; ++l) result[l] = CORE_DONE;
    if (done == LANES_ALL) return;
    for (int l = 0; l < LANES; ++l) {
        if (done >> l & 1u) continue;
        if (which >> l & 1u) result[l] = alone(g, &before, s, l, in, out);
        else {
            core_state state;
            take_out(&before, l, &state, line);
            put_back(&state, s, l, line);
        }
    }
}

/* Columns of the interface's inputs, of a run: a value for each actuator, `stride` apart, or, where that is 0, one for all.
 * `row` has the latter; `varying` lists the others. The motion that is one for all has a number above 0. */
typedef struct {
    const double *const *columns;
    const size_t *stride;
    lanes row[MODEL_INPUTS];
    int varying[MODEL_INPUTS], count;
    uint64_t shared;
} input_columns;

static input_columns opened(const double *const *columns, const size_t *stride, uint64_t motion)
{
    input_columns c = {.columns = columns, .stride = stride, .shared = motion};
    for (int i = 0; i < MODEL_INPUTS; ++i) {
        if (stride[i]) {
            c.varying[c.count++] = i;
            if (i >= INPUT_ACCELERATION_X && i < INPUT_ACCELERATION_X + MODEL_MOTION) c.shared = 0;
        } else {
            c.row[i] = lanes_set(*columns[i]);
        }
    }
    return c;
}

/* What the vehicle's motion makes of a group, anew if it has changed. */
static void carry(group *at, const input_columns *c)
{
    const lanes *motion = c->row + INPUT_ACCELERATION_X;
    if (c->shared && at->shared == c->shared) return;
    lanes_mask same = lanes_of_bits(at->shared ? 0 : LANES_ALL);
    for (int i = 0; i < MODEL_MOTION; ++i) same = lanes_both(same, lanes_equal(at->motion[i], motion[i]));
    at->shared = c->shared;
    if (lanes_bits(same) == LANES_ALL) return;
    memcpy(at->motion, motion, sizeof at->motion);
    vector_carried(LANES_ALL, at->of->parameters, at->of->constants, MODEL_MOTION_OF(motion), at->carried);
}

/* A group's inputs. */
static void gather(group *at, const size_t *actuator, bool beside, input_columns *c, group_inputs *in)
{
    lanes *row = c->row;
    for (int k = 0; k < c->count; ++k) {
        const int i = c->varying[k];
        if (beside && c->stride[i] == 1) row[i] = lanes_load(c->columns[i] + actuator[0]);
        else
            for (int l = 0; l < LANES; ++l) *group_at(&row[i], l) = c->columns[i][actuator[l] * c->stride[i]];
    }
    carry(at, c);
    in->command = row[INPUT_FIN_COMMAND];
    in->loads[0] = row[INPUT_AERO_TORQUE];
    for (int i = 0; i < CORE_CARRIED; ++i) in->loads[i + 1] = at->carried[i];
    in->supply = lanes_set(0.0);
#if MODEL_SUPPLY >= 0
    in->supply = row[MODEL_SUPPLY];
#endif
    in->enable = row[INPUT_ENABLE];
    for (int i = 0; i < CORE_FURTHER; ++i) in->further[i] = row[MODEL_INPUTS - CORE_FURTHER + i];
    in->further[CORE_FURTHER] = lanes_set(0.0);
}

/* Have what a step of a group needs on its way from memory. */
static void expect(const group *at, size_t bytes)
{
    const char *here = (const char *)&at->state.period, *end = (const char *)at + bytes;
    for (; here < end; here += 64) __builtin_prefetch(here);
}

/* Groups first to last - 1 of `bytes` each, to `end` [s]; the actuator of each lane in `order`, one repeated where a
 * group is not full. `motion` is the number of the vehicle's motion if all have the same: as before, or another. Gives
 * how many did not get there. */
API size_t batch_run(char *groups, size_t bytes, size_t first, size_t last, size_t count, const size_t *order, double end,
                     const double *const *columns, const size_t *stride, uint64_t motion, double *out,
                     size_t out_stride, int *result)
{
    size_t failed = 0;
    group_step g = {.p = NULL};
    input_columns inputs = opened(columns, stride, motion);
    for (size_t k = first; k < last; ++k) {
        group *at = (group *)(groups + k * bytes);
        if (k + 1 < last) expect((const group *)(groups + (k + 1) * bytes), bytes);
        const size_t *actuator = order + k * LANES;
        const size_t full = count - k * LANES < LANES ? count - k * LANES : LANES;
        const bool beside = actuator[LANES - 1] == actuator[0] + LANES - 1;
        lanes outputs[MODEL_OUTPUTS];
        group_inputs in;
        int results[LANES];
        gather(at, actuator, beside, &inputs, &in);
        if (at->of->parameters != g.p) g = prepared(at->of, end);
        move(&g, &at->state, LANES_ALL, &in, outputs, results);
        for (int i = 0; i < MODEL_OUTPUTS; ++i) {
            double *column = out + (size_t)i * out_stride;
            if (beside) lanes_store(column + actuator[0], outputs[i]);
            else
                for (size_t l = 0; l < full; ++l) column[actuator[l]] = *group_at(&outputs[i], (int)l);
        }
        for (size_t l = 0; l < full; ++l) {
            result[actuator[l]] = results[l];
            failed += results[l] != CORE_DONE;
        }
    }
    return failed;
}
