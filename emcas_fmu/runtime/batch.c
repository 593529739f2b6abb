/* The actuator as a library for the Python API: one, many, and whole runs at a call. */
#include "core.h"
#include "parameter_checks.h"

#if defined _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

/* One actuator, laid out by its user: actuator_size() bytes, aligned for double. */
typedef struct {
    double parameters[MODEL_PARAMETERS];
    double constants[KERNEL_CONSTANTS];
    double motion[MODEL_MOTION];
    double carried[CORE_CARRIED]; /* by this motion */
    core_state state;
} actuator;

API size_t actuator_size(void)
{
    return sizeof(actuator);
}

/* Where in it, and how long, the changing state is. */
API size_t actuator_state(size_t *size)
{
    *size = sizeof(core_state);
    return offsetof(actuator, state);
}

/* Follow parameters that changed. Gives 0, and does nothing, if they are no set to compute with. */
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
    core_start(a->parameters, a->constants, &a->state);
    return 1;
}

API void actuator_carried(const actuator *a, const double *motion, double *out)
{
    core_carried(a->parameters, a->constants, motion, out);
}

static void outputs(const actuator *a, const core_inputs *in, double *out)
{
    const core_schedule plan = core_scheduled(a->parameters, a->constants);
    core_outputs(a->parameters, a->constants, &a->state, &plan, in, out);
}

/* The core's inputs as an array: command, loads, supply, enable, the actuator's further ones. */
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

/* Core.run: to `end` [s] with the core's inputs, held or with a core_ramp as an array. */
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
        actuator_carried(a, a->motion, a->carried);
    }
    core_inputs_of(in, a->carried, out);
}

/* `count` actuators, each to `end` [s] with its own row of the interface's inputs and outputs.
 * A result for each; gives how many did not get there. */
API size_t actuators_run(actuator *a, size_t count, double end, const double *in, double *out, int *result)
{
    size_t failed = 0;
    for (size_t i = 0; i < count; ++i) {
        core_inputs inputs;
        row(a + i, in + i * MODEL_INPUTS, &inputs);
        result[i] = core_run(a[i].parameters, a[i].constants, &a[i].state, end, &inputs, NULL, out + i * MODEL_OUTPUTS);
        failed += result[i] != CORE_DONE;
    }
    return failed;
}

/* A whole run from the start: the outputs at `rows` times `step` [s] apart, the first at 0, with
 * the inputs of each row held until the next. Gives how many rows were reached. */
API size_t actuator_simulate(actuator *a, size_t rows, double step, const double *in, double *out, int *result)
{
    if (rows == 0) return 0;
    core_inputs inputs;
    row(a, in, &inputs);
    outputs(a, &inputs, out);
    for (size_t k = 1; k < rows; ++k) {
        /* The last row's inputs act nowhere: what is put out at a row is under those before it. */
        *result = core_run(a->parameters, a->constants, &a->state, (double)k * step, &inputs, NULL,
                           out + k * MODEL_OUTPUTS);
        if (*result != CORE_DONE) return k;
        row(a, in + k * MODEL_INPUTS, &inputs);
    }
    return rows;
}
