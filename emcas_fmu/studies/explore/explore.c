/* The functions that a page calls: rules of the parameters, simulation, torque limits, and equations at rest. */
#include "batch.c"
#include "limits.h"
#include "linear.h"

/* Returns whether the parameters break a rule, and writes the numbers of the rule's message from numbers[1] on. */
API int rule_broken(size_t number, const double *parameters, double *numbers)
{
    double constants[RULES_CONSTANTS];
    rules_prepare(parameters, constants);
    return rules_broken(&RULE[number], parameters, constants, numbers);
}

/* Simulates the actuator from its start and writes all outputs at `rows` points of time, `step` [s] apart, column by
 * column like the inputs `in`. Returns the number of rows reached; `result` is the reason for the end (run_tables). */
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
/* Returns the number of constants of the equations at rest, and writes them unless `constants` is null. */
API size_t at_rest_prepare(const double *parameters, double *constants)
{
    at_rest_begin(0);
    if (constants) linear_prepare(parameters, constants);
    return LINEAR_CONSTANTS;
}

/* Writes the fields of the schedule, in the order of runtime/schedule.py. */
API void scheduled(const double *parameters, double *out)
{
    double constants[KERNEL_CONSTANTS + 1];
    kernel_prepare(parameters, constants);
    kernel_schedule(parameters, constants, out);
}
#endif
