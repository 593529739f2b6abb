/* The actuator for a page: batch.c, and which rules a set of parameters breaks. */
#include "batch.c"

/* Whether a rule is broken; the numbers of its message are numbers[1] and on. */
API int rule_broken(size_t number, const double *parameters, double *numbers)
{
    double constants[RULES_CONSTANTS];
    rules_prepare(parameters, constants);
    return rules_broken(&RULE[number], parameters, constants, numbers);
}
