/* The actuator of a page: batch.c, and the rules of its parameters. */
#include "batch.c"

/* Returns whether the parameters break a rule; its message's numbers begin at numbers[1]. */
API int rule_broken(size_t number, const double *parameters, double *numbers)
{
    double constants[RULES_CONSTANTS];
    rules_prepare(parameters, constants);
    return rules_broken(&RULE[number], parameters, constants, numbers);
}
