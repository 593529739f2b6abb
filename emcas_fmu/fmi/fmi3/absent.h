/* Functions of FMI 3.0 that the FMU does not support: they log an error. They are exported because hosts look up all
 * of them; the model description says that none is supported. A part of fmi3.c.
 */
#ifndef EMCAS_ABSENT_H
#define EMCAS_ABSENT_H

#include "instance.h"

/* Uses arguments that are otherwise unused. */
static void ignore(int first, ...)
{
    (void)first;
}

#define ABSENT(Name, why, parameters, ...)                                                                        \
    fmi3Status fmi3##Name parameters                                                                              \
    {                                                                                                             \
        ignore(0, __VA_ARGS__);                                                                                   \
        return c ? report(c, STATUS_ERROR, "fmi3%s: %s", #Name, why) : fmi3Error;                                 \
    }

ABSENT(GetNumberOfVariableDependencies, "providesPerElementDependencies is false", (fmi3Instance c, fmi3ValueReference
       vr, size_t *n), vr, n)
ABSENT(GetVariableDependencies, "providesPerElementDependencies is false", (fmi3Instance c, fmi3ValueReference vr,
       size_t a[], fmi3ValueReference b[], size_t d[], fmi3DependencyKind kinds[], size_t n), vr, a, b, d, kinds, n)
ABSENT(GetDirectionalDerivative, "providesDirectionalDerivatives is false", (fmi3Instance c, const fmi3ValueReference
       unknowns[], size_t n_unknowns, const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
       size_t n_seed, fmi3Float64 out[], size_t n_out), unknowns, n_unknowns, knowns, n_knowns, seed, n_seed, out,
       n_out)
ABSENT(GetAdjointDerivative, "providesAdjointDerivatives is false", (fmi3Instance c, const fmi3ValueReference
       unknowns[], size_t n_unknowns, const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
       size_t n_seed, fmi3Float64 out[], size_t n_out), unknowns, n_unknowns, knowns, n_knowns, seed, n_seed, out,
       n_out)
ABSENT(GetOutputDerivatives, "maxOutputDerivativeOrder is 0", (fmi3Instance c, const fmi3ValueReference vr[], size_t
       n, const fmi3Int32 orders[], fmi3Float64 values[], size_t count), vr, n, orders, values, count)
ABSENT(EnterConfigurationMode, "there are no structural parameters", (fmi3Instance c), c)
ABSENT(ExitConfigurationMode, "there are no structural parameters", (fmi3Instance c), c)
ABSENT(GetIntervalFraction, "supportsFraction is false", (fmi3Instance c, const fmi3ValueReference vr[], size_t n,
       fmi3UInt64 counters[], fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]), vr, n, counters,
       resolutions, qualifiers)
ABSENT(GetShiftFraction, "supportsFraction is false", (fmi3Instance c, const fmi3ValueReference vr[], size_t n,
       fmi3UInt64 counters[], fmi3UInt64 resolutions[]), vr, n, counters, resolutions)
ABSENT(SetIntervalDecimal, "the interval is that of the controller", (fmi3Instance c, const fmi3ValueReference vr[],
       size_t n, const fmi3Float64 intervals[]), vr, n, intervals)
ABSENT(SetIntervalFraction, "the interval is that of the controller", (fmi3Instance c, const fmi3ValueReference vr[],
       size_t n, const fmi3UInt64 counters[], const fmi3UInt64 resolutions[]), vr, n, counters, resolutions)
ABSENT(SetShiftDecimal, "the shift is 0", (fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64
       shifts[]), vr, n, shifts)
ABSENT(SetShiftFraction, "the shift is 0", (fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3UInt64
       counters[], const fmi3UInt64 resolutions[]), vr, n, counters, resolutions)
ABSENT(EvaluateDiscreteStates, "providesEvaluateDiscreteStates is false", (fmi3Instance c), c)
ABSENT(EnterContinuousTimeMode, "there is no model exchange", (fmi3Instance c), c)
ABSENT(CompletedIntegratorStep, "there is no model exchange", (fmi3Instance c, fmi3Boolean a, fmi3Boolean *b,
       fmi3Boolean *d), a, b, d)
ABSENT(SetTime, "there is no model exchange", (fmi3Instance c, fmi3Float64 time), time)
ABSENT(SetContinuousStates, "there is no model exchange", (fmi3Instance c, const fmi3Float64 x[], size_t n), x, n)
ABSENT(GetContinuousStateDerivatives, "there is no model exchange", (fmi3Instance c, fmi3Float64 x[], size_t n), x, n)
ABSENT(GetEventIndicators, "there is no model exchange", (fmi3Instance c, fmi3Float64 z[], size_t n), z, n)
ABSENT(GetContinuousStates, "there is no model exchange", (fmi3Instance c, fmi3Float64 x[], size_t n), x, n)
ABSENT(GetNominalsOfContinuousStates, "there is no model exchange", (fmi3Instance c, fmi3Float64 x[], size_t n), x, n)
ABSENT(GetNumberOfEventIndicators, "there is no model exchange", (fmi3Instance c, size_t *n), n)
ABSENT(GetNumberOfContinuousStates, "there is no model exchange", (fmi3Instance c, size_t *n), n)
ABSENT(ActivateModelPartition, "there is no scheduled execution", (fmi3Instance c, fmi3ValueReference clock,
       fmi3Float64 time), clock, time)

#endif
