"""FMI 3.0 of the native back end."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...runtime.c_sources import c_text
from ...variables import Variable
from ..format import Format, HostVariable, about, standard_headers
from ..interface import FmuInterface
from .arrays import CLOCK, TIME, arrays
from .model_description import model_description

_TYPES = {"Float64": "FLOAT64", "Int32": "INT32", "UInt32": "UINT32", "Enumeration": "INT64", "Boolean": "BOOL"}
_NAMES = {**{name: name for name in _TYPES}, "Enumeration": "Enumeration (Int64)", "Clock": "Clock"}


def _tables(interface: FmuInterface, clock: bool = False) -> str:
    """Return C code with the indices of the elements of each variable, and constants for clock and events."""
    rows = [(interface.spelt(v.variable.name), _TYPES[v.kind], v.first, v.table or 1, v.fins or 1, v.stride)
            for v in arrays(interface)]
    rows += [(TIME.name, "FLOAT64", len(interface.variables), 1, 1, 0),
             *([(CLOCK, "TICKS", len(interface.variables), 1, 1, 0)] if clock else ())]
    listed = ",\n".join(f"    {{{c_text(name)}, {', '.join(map(str, row))}}}" for name, *row in rows)
    actuator = interface.actuator
    sample_time = [v.name for v in actuator.parameters].index("controller.sample_time")
    fin_rate = [v.name for v in actuator.outputs].index("fin_rate")
    types, names = ", ".join((*_TYPES.values(), "TICKS")), ", ".join(map(c_text, _NAMES.values()))
    return ("\n/* Types of FMI 3.0, and the indices of the elements of a variable: `size` of a fin from `first` on, "
            f"those of the\n * next fin `stride` further. */\nenum {{ {types} }};\n"
            f"static const char *const TYPE[] = {{{names}}};\n\n"
            "typedef struct {\n    const char *name;\n    int type;\n"
            "    unsigned first, size, fins, stride;\n} array;\n\n"
            f"enum {{ TIME = {len(rows) - 1 - clock}, ARRAYS = {len(rows)} }};\n"
            f"#define CLOCK_NAME {c_text(CLOCK)}\n"
            f"static const array ARRAY[ARRAYS] = {{\n{listed}\n}};\n\n"
            "/* The index of the sample time among a fin's parameters, of the rate among its outputs. */\n"
            f"enum {{ SAMPLE_TIME = {sample_time}, OUTPUT_FIN_RATE = {fin_rate} }};\n")


def _host_variables(interface: FmuInterface, clock: bool = False) -> Iterator[HostVariable]:
    listed = arrays(interface)
    for reference, v in enumerate(listed):
        shape = " x ".join(map(str, v.dimensions))
        yield HostVariable(v.variable.name, reference, about(
            v.variable.causality, _NAMES[v.kind], v.variable.unit if v.kind == "Float64" else "",
            shape and f"{shape} values"))
    yield HostVariable(TIME.name, len(listed), about(TIME.causality, "Float64", TIME.unit))
    if clock:
        yield HostVariable(CLOCK, len(listed) + 1, about("input", "Clock", ""))


def _listed(interface: FmuInterface) -> Iterator[tuple[Variable, str, tuple[int, ...]]]:
    return ((v.variable, " × ".join(map(str, v.dimensions)), v.indices) for v in arrays(interface))


def _in_files(interface: FmuInterface, fins: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Return columns or values by the names of the interface; those of several fins have one more dimension."""
    first = fins[0]
    return {name if name == "time" else interface.spelt(interface.array_name(name)):
            first[name] if name == "time" or interface.array_name(name) == name else np.stack(
                [each[name] for each in fins], axis=-1) for name in first}


FORMAT = Format(
    version="3.0", main="fmi3.c", package="emcas_fmu.fmi.fmi3", written=("absent.h", "clock.h", "events.h"),
    headers=lambda: standard_headers(("fmi3Functions.h", "fmi3FunctionTypes.h", "fmi3PlatformTypes.h")),
    by_machine=True, of_sources={}, tables=_tables,
    host_variables=_host_variables, listed=_listed, in_files=_in_files, model_description=model_description,
    options={"needsExecutionTool": "false", "canBeInstantiatedOnlyOncePerProcess": "false",
             "canGetAndSetFMUState": "true", "canSerializeFMUState": "true", "providesDirectionalDerivatives": "false",
             "canHandleVariableCommunicationStepSize": "true", "maxOutputDerivativeOrder": "0",
             "providesIntermediateUpdate": "false", "mightReturnEarlyFromDoStep": "true", "hasEventMode": "true"},
    notes=(
        "This FMU is compiled from C and needs nothing in its host; <code>sources</code> has the code, and for a host "
        "in C a header with the instantiation token and the value references.",
        "Inputs are held over a step.",
        "Event mode is optional, and the trajectory is the same with it and without. Where a host uses it, a step that "
        "changes a discrete output, or lets a fin stick or come loose, asks for event handling; where early return is "
        "allowed, too, the step ends there, to within a thousandth of the sample time. What begins and ends within a "
        "tick is not seen.",
        "A call out of order or with an unknown reference is answered with <code>fmi3Error</code> at once, nothing "
        "changed; an input that is not finite with <code>fmi3Error</code> from the step. The instance may be used on.",
        "A step that cannot be followed is answered with <code>fmi3Discard</code>, the state unchanged.",
        "Parameters out of range give <code>fmi3Error</code> at the end of initialization; correct them and repeat the "
        "call. A wrong instantiation token is refused by <code>fmi3InstantiateCoSimulation</code>."))

CLOCKED = replace(
    FORMAT, tables=partial(_tables, clock=True), host_variables=partial(_host_variables, clock=True),
    model_description=partial(model_description, clock=True), notes=(*FORMAT.notes, (
        f"<code>{CLOCK}</code> says when the controllers sample (of fin 1, where their sample times differ). It need "
        "not be activated: they sample by themselves.")))
"""With a clock of the controllers' samples. Hosts made with fmi4c crash with a double free at any clock."""
