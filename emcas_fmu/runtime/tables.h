/* Many whole runs as a library for the Python API, LANES at a time. */
#ifndef EMCAS_TABLES_H
#define EMCAS_TABLES_H

#include "many.h"

/* An input of many runs: its first value, and the strides [doubles] to the next run and to the next row; a stride is 0
 * if the value repeats. */
typedef struct {
    const double *first;
    ptrdiff_t run, row;
} input_column;

/* An output of many runs, with the same strides; `index` is its index among the outputs. It is stored at every
 * `every`th point of time. */
typedef struct {
    double *first;
    ptrdiff_t run, row;
    size_t index, every;
} output_column;

/* Additional results of a run, after those of core_result. RUN_ALONE: to be simulated with one lane. */
enum { RUN_REFUSED = CORE_TOO_MANY_TICKS + 1, RUN_INPUT_NOT_FINITE, RUN_ALONE };

/* Many whole runs: their outputs at `points` points of time, `step` [s] apart and the first at 0. Each row of the
 * inputs, which have MODEL_INPUTS columns, is held for `held` steps. The `spring` of a run, unless NULL, subtracts its
 * stiffness [N.m/rad] times the output `angle` at a row from the row's aero_torque. `reached` is the number of points
 * that each run reached, and `result` the reason why it ended; outputs at later points are not written. */
typedef struct {
    size_t points, held, angle, columns;
    double step;
    const input_column *in;
    const output_column *out;
    const double *spring;
    int64_t *reached;
    int *result;
} run_tables;

/* Read row `k` of the inputs of a group's runs; returns the lanes whose inputs are finite. */
static unsigned table_row(const input_column *in, const size_t *run, size_t k, lanes *row)
{
    lanes sum = lanes_set(0.0);
    for (int i = 0; i < MODEL_INPUTS; ++i) {
        const double *at = in[i].first + (ptrdiff_t)k * in[i].row;
        row[i] = lanes_set(*at);
        if (in[i].run)
            for (int l = 0; l < LANES; ++l) set_lane(&row[i], l, at[(ptrdiff_t)run[l] * in[i].run]);
        sum = sum + (row[i] - row[i]);
    }
    return lanes_bits(lanes_finite(sum));
}

/* End the runs of the lanes in `which` but not in `going` at point `k` for a reason; returns the others. */
static unsigned end_runs(const run_tables *t, const size_t *run, unsigned which, unsigned going, size_t k, int reason)
{
    for (int l = 0; l < LANES; ++l) {
        if (!((which & ~going) >> l & 1u)) continue;
        t->reached[run[l]] = (int64_t)k;
        t->result[run[l]] = reason;
    }
    return which & going;
}

/* Simulate the runs `run`, in the lanes `which` of a group. With several lanes, the result of a run that does not stay
 * with the others, or that cannot be computed, is RUN_ALONE. */
static void simulate(const lanes *values, unsigned which, const size_t *run, const run_tables *t)
{
    group at;
    core_inputs inputs;
    core_result why = CORE_DONE;
    lanes row[MODEL_INPUTS], now[MODEL_OUTPUTS], stiffness = lanes_set(0.0);
    for (int l = 0; t->spring && l < LANES; ++l) set_lane(&stiffness, l, t->spring[run[l]]);
    const group_step g = prepared(values, 0.0);
    start(&at, values, sizeof at);
    which = end_runs(t, run, which, lanes_bits(g.together), 0, RUN_ALONE);
    for (size_t k = 0; which && k < t->points; ++k) {
        if (k) {
            const unsigned going = lanes_bits(core_move(g.p, g.c, lanes_of_bits(which), &at.state, &g.plan,
                                                        (double)k * t->step, &inputs, NULL, now, &why));
            which = end_runs(t, run, which, going, k, LANES > 1 ? RUN_ALONE : (int)why);
            if (!which) return;
        }
        if (k % t->held == 0) {
            const unsigned finite = table_row(t->in, run, k / t->held, row);
            which = end_runs(t, run, which, finite, k, LANES > 1 ? RUN_ALONE : RUN_INPUT_NOT_FINITE);
            update_motion_loads(&at, &g, row + INPUT_ACCELERATION_X, 0);
            core_inputs_of(row, at.motion_loads, &inputs);
        }
        if (k == 0) core_outputs(g.p, g.c, EVERY_LANE, &at.state, &at.state.tentative, &g.plan, &inputs, now);
        if (t->spring && k % t->held == 0) inputs.loads[0] = inputs.loads[0] - stiffness * now[t->angle];
        for (size_t j = 0; j < t->columns; ++j) {
            const output_column *out = &t->out[j];
            size_t stored = k;
            if (out->every > 1) { /* usually it is 1, and a division is slow */
                if (k % out->every) continue;
                stored = k / out->every;
            }
            double *to = out->first + (ptrdiff_t)stored * out->row;
            for (int l = 0; l < LANES; ++l)
                if (which >> l & 1u) to[(ptrdiff_t)run[l] * out->run] = lanes_of(now[out->index], l);
        }
    }
    end_runs(t, run, which, 0, t->points, CORE_DONE);
}

/* Simulate the runs listed in `order`, in which neighbours have similar schedules, from the start. The `values` of the
 * runs are `stride` [doubles] apart (0: one set for all). Runs with the result RUN_ALONE must be simulated by a library
 * with one lane. */
API void batch_simulate(size_t count, const size_t *order, const double *values, size_t stride, const run_tables *t)
{
    lanes each[VALUES];
    fill(each, values);
    for (size_t first = 0; first < count; first += LANES) {
        size_t run[LANES];
        const size_t full = count - first < LANES ? count - first : LANES;
        for (size_t l = 0; l < LANES; ++l) {
            run[l] = order[first + (l < full ? l : full - 1)];
            for (size_t i = 0; stride && i < VALUES; ++i) set_lane(&each[i], (int)l, values[run[l] * stride + i]);
        }
        simulate(each, (1u << full) - 1u, run, t);
    }
}

#endif
