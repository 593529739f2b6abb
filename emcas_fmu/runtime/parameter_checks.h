/* Checks of a set of parameters, by the limits and rules of rules.h, which is generated. */
#ifndef EMCAS_PARAMETER_CHECKS_H
#define EMCAS_PARAMETER_CHECKS_H

#include "core.h"
#include "rules.h"

/* Whether the parameters break a rule; numbers[1] and following are the numbers of its message, at the worst share. */
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

/* Whether the parameters keep those of `count` rules that are not warnings. */
static inline bool rules_kept(const rule *some, size_t count, const double *p, const double *constants)
{
    double numbers[RULE_NUMBERS + 1];
    for (size_t i = 0; i < count; ++i)
        if (!some[i].warning && rules_broken(&some[i], p, constants, numbers)) return false;
    return true;
}

/* The limits come first: rules apply to values within them only. */
static inline bool rules_hold(const double *p)
{
    double constants[RULES_CONSTANTS];
    for (size_t i = 0; i < MODEL_PARAMETERS; ++i)
        if (!core_finite(p[i]) || p[i] < LIMIT[i].minimum || p[i] > LIMIT[i].maximum) return false;
    rules_prepare(p, constants);
    return rules_kept(RULE, RULES, p, constants);
}

/* Whether the line of several fins keeps its rules, with parameters within their limits. */
static inline bool line_rules_hold(const double *line)
{
#if LINE_RULES
    double constants[LINE_RULES_CONSTANTS + 1];
    line_rules_prepare(line, constants);
    return rules_kept(LINE_RULE, LINE_RULES, line, constants);
#else
    (void)line;
    return true;
#endif
}

#endif
