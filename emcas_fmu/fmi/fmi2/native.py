"""FMI 2.0 of the native back end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ...errors import BuildError
from ...variables import Variable
from ..format import Format, HostVariable, about, standard_headers
from ..interface import FmuInterface
from .model_description import model_description

# fmpy's copy of the standard's header lacks the prefix that several FMUs linked into one program need.
_NO_PREFIX = "This definition has been changed to add no prefix.\n*/\n#define fmi2FullName(name) name\n"
_PREFIX = """FMI2_FUNCTION_PREFIX, if defined, goes before each name.
*/
#if defined(FMI2_FUNCTION_PREFIX)
#define fmi2Paste(a, b) a ## b
#define fmi2PasteB(a, b) fmi2Paste(a, b)
#define fmi2FullName(name) fmi2PasteB(FMI2_FUNCTION_PREFIX, name)
#else
#define fmi2FullName(name) name
#endif
"""


def _headers() -> dict[str, str]:
    headers = standard_headers(("fmi2Functions.h", "fmi2FunctionTypes.h", "fmi2TypesPlatform.h"))
    if _NO_PREFIX not in headers["fmi2Functions.h"]:
        raise BuildError("fmi2Functions.h of this version of fmpy is not as expected: fmpy 0.3.25 to 0.3.32 are known")
    headers["fmi2Functions.h"] = headers["fmi2Functions.h"].replace(_NO_PREFIX, _PREFIX)
    return headers


def _host_variables(interface: FmuInterface) -> Iterator[HostVariable]:
    for reference, v in enumerate(interface.variables):
        kind = "Integer" if v.items else v.kind
        yield HostVariable(v.name, reference, about(v.causality, kind, v.unit if v.kind == "Real" else ""))


def _listed(interface: FmuInterface) -> Iterator[tuple[Variable, str, tuple[int, ...]]]:
    return ((v, "", (i,)) for i, v in enumerate(interface.variables))


def _in_files(interface: FmuInterface, fins: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    return {name if name == "time" else interface.spelt(interface.name(name, fin)): value
            for fin, each in enumerate(fins) for name, value in each.items()}


FORMAT = Format(
    version="2.0", main="fmi2.c", package="emcas_fmu.fmi.fmi2", written=(), headers=_headers, by_machine=False,
    of_sources={"source_files": ("fmi2.c",)},
    tables=lambda interface: "", host_variables=_host_variables, listed=_listed,
    in_files=_in_files, model_description=model_description,
    options={"needsExecutionTool": "false", "canHandleVariableCommunicationStepSize": "true",
             "canInterpolateInputs": "true", "maxOutputDerivativeOrder": "0", "canRunAsynchronuously": "false",
             "canBeInstantiatedOnlyOncePerProcess": "false", "canNotUseMemoryManagementFunctions": "false",
             "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true", "providesDirectionalDerivative": "false"},
    notes=(
        "This FMU is compiled from C and needs nothing in its host; <code>sources</code> has the code, and for a host "
        "in C a header with the GUID and the value references.",
        "Inputs are held over a step, or ramp through it with the first derivatives that "
        "<code>fmi2SetRealInputDerivatives</code> gives; derivatives hold for one step.",
        "A call out of order or with an unknown reference is answered with <code>fmi2Error</code> at once, nothing "
        "changed; an input that is not finite with <code>fmi2Error</code> from the step. The instance may be used on.",
        "A step that cannot be followed is answered with <code>fmi2Discard</code>, the state unchanged.",
        "Parameters out of range give <code>fmi2Error</code> at the end of initialization; correct them and repeat the "
        "call. A wrong GUID is refused by <code>fmi2Instantiate</code>."))
