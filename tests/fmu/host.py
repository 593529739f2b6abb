"""A minimal FMI 2.0 host on ctypes: standard library only, so that it runs where nothing is installed."""

from __future__ import annotations

import ctypes as ct
import pathlib
import platform
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

OK, WARNING, DISCARD, ERROR, FATAL = range(5)
_CTYPES: dict[str, Any] = {"Real": ct.c_double, "Integer": ct.c_int, "Boolean": ct.c_int}
_GOT_AS = {"Enumeration": "Integer"}
_LOGGER = ct.CFUNCTYPE(None, ct.c_void_p, ct.c_char_p, ct.c_int, ct.c_char_p, ct.c_char_p)


class _Callbacks(ct.Structure):
    _fields_ = (("logger", _LOGGER), ("allocate", ct.c_void_p), ("free", ct.c_void_p), ("finished", ct.c_void_p),
                ("environment", ct.c_void_p))


class Fmu:
    """An unpacked FMU: its description and its loaded library."""

    def __init__(self, folder: str) -> None:
        self.folder = pathlib.Path(folder)
        root = ET.parse(self.folder / "modelDescription.xml").getroot()
        self.guid = root.attrib["guid"]
        variables = root.findall("ModelVariables/ScalarVariable")
        self.references = {v.attrib["name"]: int(v.attrib["valueReference"]) for v in variables}
        self.kinds = {v.attrib["name"]: _GOT_AS.get(v[0].tag, v[0].tag) for v in variables}
        self.outputs = [v.attrib["name"] for v in variables if v.attrib["causality"] == "output"]
        identifier = root.find("CoSimulation").attrib["modelIdentifier"]  # type: ignore[union-attr]
        system, suffix = {"Linux": ("linux64", ".so"), "Windows": ("win64", ".dll")}[platform.system()]
        self.library = ct.CDLL(str(self.folder / "binaries" / system / (identifier + suffix)))
        self.library.fmi2Instantiate.restype = ct.c_void_p


class Instance:
    """An instance; every call gives its FMI status, `log` collects (status, message)."""

    def __init__(self, fmu: Fmu, name: str = "fin", guid: str | None = None, logging: bool = True,
                 kind: int = 1) -> None:
        self.fmu = fmu
        self.log: list[tuple[int, str]] = []
        self._logger = _LOGGER(lambda _, __, status, ___, message: self.log.append((status, message.decode())))
        self._callbacks = _Callbacks(self._logger)
        self.component = ct.c_void_p(fmu.library.fmi2Instantiate(
            name.encode(), kind, (guid or fmu.guid).encode(), (fmu.folder / "resources").as_uri().encode(),
            ct.byref(self._callbacks), 0, int(logging)))

    def call(self, function: str, *arguments: Any) -> int:
        status: int = getattr(self.fmu.library, function)(self.component, *arguments)
        return status

    def setup(self, start: float = 0.0) -> int:
        return self.call("fmi2SetupExperiment", 0, ct.c_double(0.0), ct.c_double(start), 0, ct.c_double(0.0))

    def initialize(self, start: float = 0.0, **values: Any) -> list[int]:
        statuses = [self.setup(start), self.call("fmi2EnterInitializationMode")]
        statuses += [self.set(name, value) for name, value in values.items()]
        return [*statuses, self.call("fmi2ExitInitializationMode")]

    def step(self, time: float, size: float) -> int:
        return self.call("fmi2DoStep", ct.c_double(time), ct.c_double(size), 1)

    def run(self, begin: float, end: float, size: float, **inputs: Any) -> int:
        """Steps with the inputs held; the worst status."""
        worst = max((self.set(name, value) for name, value in inputs.items()), default=OK)
        for k in range(round((end - begin) / size)):
            worst = max(worst, self.step(begin + k * size, size))
        return worst

    def set_vr(self, kind: str, reference: int, value: Any) -> int:
        ctype = _CTYPES[kind]
        return self.call(f"fmi2Set{kind}", (ct.c_uint * 1)(reference), ct.c_size_t(1), (ctype * 1)(value))

    def set(self, name: str, value: Any) -> int:
        name = name.replace("__", ".")
        return self.set_vr(self.fmu.kinds[name], self.fmu.references[name], value)

    def get_vr(self, kind: str, references: Sequence[int]) -> tuple[int, list[Any]]:
        ctype = _CTYPES[kind]
        values = (ctype * len(references))()
        status = self.call(f"fmi2Get{kind}", (ct.c_uint * len(references))(*references),
                           ct.c_size_t(len(references)), values)
        return status, list(values)

    def get(self, name: str) -> Any:
        status, (value,) = self.get_vr(self.fmu.kinds[name], [self.fmu.references[name]])
        assert status == OK, status
        return value

    def differentiate(self, name: str, order: int, value: float) -> int:
        """fmi2SetRealInputDerivatives of one variable."""
        return self.call("fmi2SetRealInputDerivatives", (ct.c_uint * 1)(self.fmu.references[name]), ct.c_size_t(1),
                         (ct.c_int * 1)(order), (ct.c_double * 1)(value))

    def status(self, kind: str, which: int) -> tuple[int, Any]:
        """fmi2Get<kind>Status: status of the call and the value."""
        value = _CTYPES[kind](-1)
        return self.call(f"fmi2Get{kind}Status", which, ct.byref(value)), value.value

    def debug(self, on: bool, categories: Sequence[str]) -> int:
        """fmi2SetDebugLogging."""
        names = (ct.c_char_p * len(categories))(*(c.encode() for c in categories))
        return self.call("fmi2SetDebugLogging", int(on), ct.c_size_t(len(categories)), names)

    def outputs(self) -> dict[str, Any]:
        return {name: self.get(name) for name in self.fmu.outputs}

    def save(self) -> ct.c_void_p:
        state = ct.c_void_p()
        assert self.call("fmi2GetFMUstate", ct.byref(state)) == OK
        return state

    def serialize(self, state: ct.c_void_p) -> bytes:
        size = ct.c_size_t()
        assert self.call("fmi2SerializedFMUstateSize", state, ct.byref(size)) == OK
        data = (ct.c_char * size.value)()
        assert self.call("fmi2SerializeFMUstate", state, data, size) == OK
        return data.raw

    def restore(self, data: bytes) -> int:
        """Deserialize and set; the worst status."""
        state = ct.c_void_p()
        buffer = (ct.c_char * len(data)).from_buffer_copy(data)
        status = self.call("fmi2DeSerializeFMUstate", buffer, ct.c_size_t(len(data)), ct.byref(state))
        if status == OK:
            status = self.call("fmi2SetFMUstate", state)
            self.call("fmi2FreeFMUstate", ct.byref(state))
        return status

    def free(self) -> None:
        self.fmu.library.fmi2FreeInstance(self.component)

    def messages(self, status: int) -> str:
        return "\n".join(message for found, message in self.log if found == status)
