/* The actuator as a library for the Python API: one actuator, many, and many whole runs in one call. */
#include "core.h"
#include "parameter_checks.h"
#include "tables.h"

#if defined __x86_64__
#include <cpuid.h>
#endif

/* One actuator, in memory that its user provides: actuator_size() bytes, aligned for double. */
typedef struct {
    double parameters[MODEL_PARAMETERS];
    double constants[KERNEL_CONSTANTS];
    double motion[MODEL_MOTION];
    double motion_loads[CORE_MOTION_LOADS]; /* caused by this motion */
    core_state state;
} actuator;

API size_t actuator_size(void)
{
    return sizeof(actuator);
}

/* Offset and size of the state within an actuator. */
API size_t actuator_state(size_t *size)
{
    *size = sizeof(core_state);
    return offsetof(actuator, state);
}

/* Use these parameters from now on. Returns 0, and changes nothing, if they break a limit or rule. */
API int actuator_bind(actuator *a, const double *parameters)
{
    if (!rules_hold(parameters)) return 0;
    memcpy(a->parameters, parameters, sizeof a->parameters);
    kernel_prepare(a->parameters, a->constants);
    a->motion[0] = NAN;
    return 1;
}

API int actuator_start(actuator *a, const double *parameters)
{
    if (!actuator_bind(a, parameters)) return 0;
    a->state = (core_state){.period = 0};
    core_start(a->parameters, a->constants, &a->state);
    return 1;
}

API void actuator_motion_loads(const actuator *a, const double *motion, double *out)
{
    core_motion_loads(a->parameters, a->constants, motion, out);
}

static void outputs(const actuator *a, const core_inputs *in, double *out)
{
    const core_schedule plan = core_scheduled(a->parameters, a->constants);
    core_outputs(a->parameters, a->constants, &a->state, &plan, in, out);
}

/* The core's inputs from an array: command, loads, supply, enable, the actuator's further inputs. */
static core_inputs listed(const double *in)
{
    core_inputs inputs = {0};
    memcpy(&inputs, in, offsetof(core_inputs, further) + CORE_FURTHER * sizeof *in);
    return inputs;
}

API void actuator_outputs(const actuator *a, const double *in, double *out)
{
    const core_inputs inputs = listed(in);
    outputs(a, &inputs, out);
}

/* Core.run: advance to `end` [s] with the core's inputs, held, or with a core_ramp as an array. */
API int actuator_run(actuator *a, double end, const double *in, const double *ramp, double *out)
{
    const core_inputs inputs = listed(in);
    core_ramp change;
    if (ramp) memcpy(&change, ramp, offsetof(core_ramp, further) + CORE_ACTING * sizeof *ramp);
    return core_run(a->parameters, a->constants, &a->state, end, &inputs, ramp ? &change : NULL, out);
}

/* A row of the interface's inputs as the core's. */
static void row(actuator *a, const double *in, core_inputs *out)
{
    if (memcmp(a->motion, in + INPUT_ACCELERATION_X, sizeof a->motion) != 0) {
        memcpy(a->motion, in + INPUT_ACCELERATION_X, sizeof a->motion);
        actuator_motion_loads(a, a->motion, a->motion_loads);
    }
    core_inputs_of(in, a->motion_loads, out);
}

/* The number of actuators in a vector of this processor, for which vectors.c is compiled: 8 with AVX-512, 4 with AVX2, 1
 * with neither, or if the system does not save their registers (Intel's manual, volume 1, 13.3 and 15.2). */
API int actuator_lanes(void)
{
#if defined __x86_64__
    unsigned a, b, c, d, kept, high;
    if (!__get_cpuid(1, &a, &b, &c, &d) || !(c >> 27 & 1u)) return 1;
    __asm__ volatile("xgetbv" : "=a"(kept), "=d"(high) : "c"(0));
    if ((kept & 0x6u) != 0x6u || !__get_cpuid_count(7, 0, &a, &b, &c, &d)) return 1;
    if ((kept & 0xe6u) == 0xe6u && (b >> 16 & 3u) == 3u) return 8;
    if (b >> 5 & 1u) return 4;
#endif
    return 1;
}

/* Advance actuators first to last - 1 to `end` [s] with the interface's inputs held. The columns of inputs have a value for
 * each actuator, `stride` [doubles] apart, 0 if one is for all. The columns of outputs are `out_stride` [doubles] apart.
 * Writes a result for each actuator; returns how many did not get there. */
API size_t actuators_run(actuator *a, size_t first, size_t last, double end, const double *const *columns,
                         const ptrdiff_t *stride, double *out, size_t out_stride, int *result)
{
    size_t failed = 0;
    for (size_t k = first; k < last; ++k) {
        double in[MODEL_INPUTS], now[MODEL_OUTPUTS];
        core_inputs inputs;
        for (size_t i = 0; i < MODEL_INPUTS; ++i) in[i] = columns[i][(ptrdiff_t)k * stride[i]];
        row(a + k, in, &inputs);
        result[k] = core_run(a[k].parameters, a[k].constants, &a[k].state, end, &inputs, NULL, now);
        failed += result[k] != CORE_DONE;
        for (size_t i = 0; result[k] == CORE_DONE && i < MODEL_OUTPUTS; ++i) out[i * out_stride + k] = now[i];
    }
    return failed;
}

/* Read the inputs of a run's row; returns 0 if one is not finite. */
static int row_at(actuator *a, const input_column *columns, size_t run, size_t k, core_inputs *out)
{
    double in[MODEL_INPUTS];
    for (size_t i = 0; i < MODEL_INPUTS; ++i)
        in[i] = columns[i].first[(ptrdiff_t)run * columns[i].run + (ptrdiff_t)k * columns[i].row];
    if (!core_all_finite(in, MODEL_INPUTS)) return 0;
    row(a, in, out);
    return 1;
}

/* One run of actuators_simulate, with an actuator at its start. Returns how many points were reached. */
static size_t simulate(actuator *a, size_t run, size_t points, double step, size_t held, const input_column *in,
                       const double *spring, size_t angle, const output_column *out, size_t columns, int *result)
{
    core_inputs inputs;
    double now[MODEL_OUTPUTS];
    *result = CORE_DONE;
    for (size_t k = 0; k < points; ++k) {
        /* The outputs at a row are those under the inputs of the row before it; the inputs of the last row never act. */
        if (k) *result = core_run(a->parameters, a->constants, &a->state, (double)k * step, &inputs, NULL, now);
        if (*result != CORE_DONE) return k;
        if (k % held == 0 && !row_at(a, in, run, k / held, &inputs)) {
            *result = RUN_INPUT_NOT_FINITE;
            return k;
        }
        if (k == 0) outputs(a, &inputs, now);
        if (spring && k % held == 0) inputs.loads[0] -= spring[run] * now[angle];
        for (size_t j = 0; j < columns; ++j)
            if (kept_at(&out[j], k)) *value_at(&out[j], run, k) = now[out[j].index];
    }
    return points;
}

/* Simulate `count` whole runs from the start. Their parameters are `apart` [doubles] from one run to the next (0: one set
 * for all). The outputs are those at `points` points of time, `step` [s] apart and the first at 0. Each row of the inputs,
 * of which there are MODEL_INPUTS columns, is held for `held` steps. The stiffness of each run's `spring`, unless NULL, times
 * the output `angle` at a row is subtracted from the row's moment. Outputs at points that a run did not reach are NaN;
 * `reached` and `result` have a number for each run. Returns how many runs are incomplete. */
API size_t actuators_simulate(size_t count, const double *parameters, size_t apart, size_t points, double step,
                              size_t held, const input_column *in, const double *spring, size_t angle,
                              const output_column *out, size_t columns, int64_t *reached, int *result)
{
    size_t failed = 0;
    for (size_t i = 0; i < count; ++i) {
        actuator a;
        size_t done = 0;
        if (actuator_start(&a, parameters + i * apart))
            done = simulate(&a, i, points, step, held, in, spring, angle, out, columns, &result[i]);
        else
            result[i] = RUN_REFUSED;
        reached[i] = (int64_t)done;
        failed += result[i] != CORE_DONE;
        not_reached(out, columns, i, done, points);
    }
    return failed;
}

/* Simulate one actuator from its start: all outputs at the rows of the table `in`. Returns how many rows were reached. */
API size_t actuator_simulate(actuator *a, size_t rows, double step, const double *in, double *out, int *result)
{
    input_column inputs[MODEL_INPUTS];
    output_column columns[MODEL_OUTPUTS];
    for (size_t i = 0; i < MODEL_INPUTS; ++i) inputs[i] = (input_column){in + i, 0, MODEL_INPUTS};
    for (size_t i = 0; i < MODEL_OUTPUTS; ++i) columns[i] = (output_column){out + i, 0, MODEL_OUTPUTS, i, 1};
    return simulate(a, 0, rows, step, 1, inputs, NULL, 0, columns, MODEL_OUTPUTS, result);
}
