"""Functions of FMI 3.0 that an FMU does not support; the FMU has them because hosts look up all functions."""

from __future__ import annotations

import re

from ...runtime.c_sources import c_text, header

_NO_VARIABLE = "there is no variable of this type"
_TYPES = ("Float32", "Int8", "UInt8", "Int16", "UInt16", "UInt64", "String", "Binary")
# Names of the functions by the reason that a call logs.
_ABSENT = {
    _NO_VARIABLE: [f"{verb}{name}" for name in _TYPES for verb in ("Get", "Set")],
    "providesPerElementDependencies is false": ["GetNumberOfVariableDependencies", "GetVariableDependencies"],
    "providesDirectionalDerivatives is false": ["GetDirectionalDerivative"],
    "providesAdjointDerivatives is false": ["GetAdjointDerivative"],
    "maxOutputDerivativeOrder is 0": ["GetOutputDerivatives"],
    "there are no structural parameters": ["EnterConfigurationMode", "ExitConfigurationMode"],
    "supportsFraction is false": ["GetIntervalFraction", "GetShiftFraction"],
    "the interval is that of the controller": ["SetIntervalDecimal", "SetIntervalFraction"],
    "the shift is 0": ["SetShiftDecimal", "SetShiftFraction"],
    "providesEvaluateDiscreteStates is false": ["EvaluateDiscreteStates"],
    "there is no model exchange": [
        "EnterContinuousTimeMode", "CompletedIntegratorStep", "SetTime", "SetContinuousStates",
        "GetContinuousStateDerivatives", "GetEventIndicators", "GetContinuousStates", "GetNominalsOfContinuousStates",
        "GetNumberOfEventIndicators", "GetNumberOfContinuousStates"],
    "there is no scheduled execution": ["ActivateModelPartition"],
}


def absent_header(types: str) -> str:
    """Return absent.h, which defines these functions with the parameters in `types`, the text of fmi3FunctionTypes.h.

    A call for variables of a type that the FMU does not have is an error only if it has value references.
    """
    parameters = dict(re.findall(r"fmi3Status fmi3(\w+)TYPE\s*\(fmi3Instance instance(.*?)\)", types, re.DOTALL))
    return header("absent", "Functions that the FMU does not support", '#include "instance.h"\n\n' + "".join(
        f"UNSUPPORTED({name}, {'BEFORE_END' if reason == _NO_VARIABLE and name.startswith('Set') else 'ANY_PHASE'}, "
        f"{'nValueReferences' if reason == _NO_VARIABLE else 1}, {c_text(reason)},\n"
        f"            (fmi3Instance c{' '.join(parameters[name].split())}))\n"
        for reason, names in _ABSENT.items() for name in names))
