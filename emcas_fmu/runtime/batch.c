/* The actuator as a library for the Python API: one actuator, many, and many whole runs in one call. */
#include "tables.h"

#if defined __x86_64__
#include <cpuid.h>
#endif

/* One actuator, in memory that its user provides: actuator_size() bytes, aligned for double. */
typedef struct {
    double values[VALUES];
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
    memcpy(a->values, parameters, MODEL_PARAMETERS * sizeof *parameters);
    kernel_prepare(a->values, a->values + MODEL_PARAMETERS);
    return 1;
}

API int actuator_start(actuator *a, const double *parameters)
{
    if (!actuator_bind(a, parameters)) return 0;
    a->state = (core_state){.time = {0, 0, 0}};
    core_start(a->values, a->values + MODEL_PARAMETERS, &a->state);
    return 1;
}

API void actuator_motion_loads(const actuator *a, const double *motion, double *out)
{
    core_motion_loads(a->values, a->values + MODEL_PARAMETERS, motion, out);
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
    const core_schedule plan = core_scheduled(a->values, a->values + MODEL_PARAMETERS);
    core_outputs(a->values, a->values + MODEL_PARAMETERS, EVERY_LANE, &a->state, &a->state.tentative, &plan, &inputs,
                 out);
}

/* Core.run: advance to `end` [s] with the core's inputs, held, or with a core_ramp as an array. */
API int actuator_run(actuator *a, double end, const double *in, const double *ramp, double *out)
{
    const core_inputs inputs = listed(in);
    core_ramp change;
    if (ramp) memcpy(&change, ramp, offsetof(core_ramp, further) + CORE_ACTING * sizeof *ramp);
    return core_run(a->values, a->values + MODEL_PARAMETERS, &a->state, end, &inputs, ramp ? &change : NULL, out);
}

/* The number of actuators in a vector of this processor, for which vectors.c is compiled: 8 with AVX-512, 4 with AVX2,
 * 1 with neither, or if the system does not save their registers (Intel's manual, volume 1, 13.3 and 15.2). */
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

/* Simulate an actuator with its parameters from the start: all outputs at the rows of the table `in`. Returns how many
 * rows were reached. */
API size_t actuator_simulate(const actuator *a, size_t rows, double step, const double *in, double *out, int *result)
{
    const size_t run = 0;
    int64_t reached;
    input_column inputs[MODEL_INPUTS];
    output_column columns[MODEL_OUTPUTS];
    for (size_t i = 0; i < MODEL_INPUTS; ++i) inputs[i] = (input_column){in + i, 0, MODEL_INPUTS};
    for (size_t i = 0; i < MODEL_OUTPUTS; ++i) columns[i] = (output_column){out + i, 0, MODEL_OUTPUTS, i, 1};
    simulate(a->values, LANES_ALL, &run,
             &(run_tables){rows, 1, 0, MODEL_OUTPUTS, step, inputs, columns, NULL, &reached, result});
    return (size_t)reached;
}
