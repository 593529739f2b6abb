/* Checks of parameters by the limits and rules of rules.h, which is generated. */
#ifndef EMCAS_PARAMETER_CHECKS_H
#define EMCAS_PARAMETER_CHECKS_H

#include "core.h"
#include "rules.h"

/* Return whether the parameters break a rule; numbers[1] and following are for its message, at the worst share. */
static inline bool rules_broken(const rule *one, const double *p, const double *constants, double *numbers)
{
    const int scan = one->scanned ? RULE_SCAN : 0;
    double out[RULE_NUMBERS + 1], worst = -HUGE_VAL;
    for (int k = -scan; k <= scan; ++k) {
        one->check(p, constants, (double)k / RULE_SCAN, out);
        if (k == -scan || out[0] > worst) {
            worst = out[0];
            memcpy(numbers, out, sizeof out);
        }
    }
    return worst > 0.0;
}

/* Return whether the parameters are within their limits and break no rule except warnings. Rules are only checked
 * within the limits. */
static inline bool rules_hold(const double *p)
{
    double constants[RULES_CONSTANTS], numbers[RULE_NUMBERS + 1];
    for (size_t i = 0; i < MODEL_PARAMETERS; ++i)
        if (!core_finite(p[i]) || p[i] < LIMIT[i].minimum || p[i] > LIMIT[i].maximum) return false;
    rules_prepare(p, constants);
    for (size_t i = 0; i < RULES; ++i)
        if (!RULE[i].warning && rules_broken(&RULE[i], p, constants, numbers)) return false;
    return true;
}

#endif
