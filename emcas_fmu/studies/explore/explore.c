/* The actuator of a page: batch.c, rules of its parameters, limits of motor and drive, its equations at rest. */
#include "batch.c"
#include "limits.h"
#include "linear.h"

/* Returns whether the parameters break a rule, and writes its message's numbers from numbers[1] on. */
API int rule_broken(size_t number, const double *parameters, double *numbers)
{
    double constants[RULES_CONSTANTS];
    rules_prepare(parameters, constants);
    return rules_broken(&RULE[number], parameters, constants, numbers);
}

/* Simulates an actuator from the start and writes all outputs at `rows` points of time, `step` [s] apart, column by
 * column as in the inputs `in`. Returns the number of rows reached, and writes the reason for the end (run_tables). */
API size_t simulate_rows(const double *parameters, size_t rows, double step, const double *in, double *out, int *result)
{
    const size_t run = 0;
    int64_t reached;
    double values[VALUES];
    input_column inputs[MODEL_INPUTS];
    output_column columns[MODEL_OUTPUTS];
    *result = RUN_REFUSED;
    if (!rules_hold(parameters)) return 0;
    memcpy(values, parameters, MODEL_PARAMETERS * sizeof *values);
    kernel_prepare(values, values + MODEL_PARAMETERS);
    for (size_t i = 0; i < MODEL_INPUTS; ++i) inputs[i] = (input_column){in + i * rows, 0, 1};
    for (size_t i = 0; i < MODEL_OUTPUTS; ++i) columns[i] = (output_column){out + i * rows, 0, 1, i, 1};
    simulate(values, LANES_ALL, &run,
             &(run_tables){rows, 1, 0, MODEL_OUTPUTS, step, inputs, columns, NULL, &reached, result});
    return (size_t)reached;
}

#ifdef LIMITS
/* Writes the largest steady motor torque [N.m] at each of `count` motor speeds [rad/s], at a supply [V]. */
API void limit_torques(const double *parameters, double supply, const double *speeds, size_t count, double *torques)
{
    double constants[LIMITS_CONSTANTS + 1];
    limits_prepare(parameters, constants);
    for (size_t k = 0; k < count; ++k)
        limits_torque(parameters, constants, supply, speeds[k], &torques[k]);
}
#endif

#ifdef LINEAR
/* Writes the constants of the equations at rest, unless `constants` is null, and returns their number. */
API size_t at_rest_prepare(const double *parameters, double *constants)
{
    at_rest_begin(0);
    if (constants) linear_prepare(parameters, constants);
    return LINEAR_CONSTANTS;
}

/* Writes the fields of the schedule (runtime/schedule.py). */
API void scheduled(const double *parameters, double *out)
{
    double constants[KERNEL_CONSTANTS + 1];
    kernel_prepare(parameters, constants);
    kernel_schedule(parameters, constants, out);
}
#endif
