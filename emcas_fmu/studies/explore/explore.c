/* The actuator of a page: batch.c, the rules of its parameters, the limits of motor and drive, the actuator at rest. */
#include "batch.c"
#include "limits.h"
#include "linear.h"

/* Returns whether the parameters break a rule; its message's numbers begin at numbers[1]. */
API int rule_broken(size_t number, const double *parameters, double *numbers)
{
    double constants[RULES_CONSTANTS];
    rules_prepare(parameters, constants);
    return rules_broken(&RULE[number], parameters, constants, numbers);
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
/* Writes the constants of the actuator at rest, and returns their number. */
API size_t at_rest_prepare(const double *parameters, double *constants)
{
    at_rest_begin(0);
    if (constants) linear_prepare(parameters, constants);
    return LINEAR_CONSTANTS;
}

/* Writes the fields of a schedule (runtime/schedule.py). */
API void scheduled(const double *parameters, double *out)
{
    double constants[KERNEL_CONSTANTS + 1];
    kernel_prepare(parameters, constants);
    kernel_schedule(parameters, constants, out);
}
#endif
