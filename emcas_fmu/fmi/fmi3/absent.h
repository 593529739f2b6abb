/* Functions of FMI 3.0 that the FMU does not support: they log an error. They are exported because hosts look up all
 * of them; the model description says that none is supported. A part of fmi3.c.
 */
#ifndef EMCAS_ABSENT_H
#define EMCAS_ABSENT_H

#include "instance.h"

#define ABSENT(Name, reason, parameters) UNSUPPORTED(Name, ANY_PHASE, 1, reason, parameters)

ABSENT(GetNumberOfVariableDependencies, "providesPerElementDependencies is false",
       (fmi3Instance c, fmi3ValueReference vr, size_t *n))
ABSENT(GetVariableDependencies, "providesPerElementDependencies is false",
       (fmi3Instance c, fmi3ValueReference vr, size_t a[], fmi3ValueReference b[], size_t d[],
        fmi3DependencyKind kinds[], size_t n))
#define DERIVATIVE_PARAMETERS                                                                                     \
    (fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns, const fmi3ValueReference knowns[],   \
     size_t n_knowns, const fmi3Float64 seed[], size_t n_seed, fmi3Float64 out[], size_t n_out)
ABSENT(GetDirectionalDerivative, "providesDirectionalDerivatives is false", DERIVATIVE_PARAMETERS)
ABSENT(GetAdjointDerivative, "providesAdjointDerivatives is false", DERIVATIVE_PARAMETERS)
ABSENT(GetOutputDerivatives, "maxOutputDerivativeOrder is 0",
       (fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[], fmi3Float64 values[],
        size_t count))
ABSENT(EnterConfigurationMode, "there are no structural parameters", (fmi3Instance c))
ABSENT(ExitConfigurationMode, "there are no structural parameters", (fmi3Instance c))
ABSENT(GetIntervalFraction, "supportsFraction is false",
       (fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[], fmi3UInt64 resolutions[],
        fmi3IntervalQualifier qualifiers[]))
ABSENT(GetShiftFraction, "supportsFraction is false",
       (fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[], fmi3UInt64 resolutions[]))
ABSENT(SetIntervalDecimal, "the interval is that of the controller",
       (fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 intervals[]))
#define FRACTION_PARAMETERS                                                                                       \
    (fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],                        \
     const fmi3UInt64 resolutions[])
ABSENT(SetIntervalFraction, "the interval is that of the controller", FRACTION_PARAMETERS)
ABSENT(SetShiftDecimal, "the shift is 0",
       (fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 shifts[]))
ABSENT(SetShiftFraction, "the shift is 0", FRACTION_PARAMETERS)
ABSENT(EvaluateDiscreteStates, "providesEvaluateDiscreteStates is false", (fmi3Instance c))
ABSENT(EnterContinuousTimeMode, "there is no model exchange", (fmi3Instance c))
ABSENT(CompletedIntegratorStep, "there is no model exchange",
       (fmi3Instance c, fmi3Boolean a, fmi3Boolean *b, fmi3Boolean *d))
ABSENT(SetTime, "there is no model exchange", (fmi3Instance c, fmi3Float64 time))
ABSENT(SetContinuousStates, "there is no model exchange", (fmi3Instance c, const fmi3Float64 x[], size_t n))
ABSENT(GetContinuousStateDerivatives, "there is no model exchange", (fmi3Instance c, fmi3Float64 x[], size_t n))
ABSENT(GetEventIndicators, "there is no model exchange", (fmi3Instance c, fmi3Float64 z[], size_t n))
ABSENT(GetContinuousStates, "there is no model exchange", (fmi3Instance c, fmi3Float64 x[], size_t n))
ABSENT(GetNominalsOfContinuousStates, "there is no model exchange", (fmi3Instance c, fmi3Float64 x[], size_t n))
ABSENT(GetNumberOfEventIndicators, "there is no model exchange", (fmi3Instance c, size_t *n))
ABSENT(GetNumberOfContinuousStates, "there is no model exchange", (fmi3Instance c, size_t *n))
ABSENT(ActivateModelPartition, "there is no scheduled execution",
       (fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time))

#endif
