"""A minimal host for FMI 2.0 and 3.0, with ctypes and the standard library only.

It reads and writes the elements of an FMI 3.0 array under their names in FMI 2.0.
"""

from __future__ import annotations

import ctypes as ct
import math
import pathlib
import platform
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import Any

OK, WARNING, DISCARD, ERROR, FATAL = range(5)
_CTYPES: dict[str, Any] = {
    "Real": ct.c_double, "Integer": ct.c_int, "Boolean": ct.c_int,
    "Float64": ct.c_double, "Int32": ct.c_int32, "UInt32": ct.c_uint32, "Int64": ct.c_int64}
_TYPES = {"Enumeration": "Integer"}
_TYPES_3 = {"Enumeration": "Int64"}
_LOGGER = ct.CFUNCTYPE(None, ct.c_void_p, ct.c_char_p, ct.c_int, ct.c_char_p, ct.c_char_p)
_LOGGER_3 = ct.CFUNCTYPE(None, ct.c_void_p, ct.c_int, ct.c_char_p, ct.c_char_p)


class _Callbacks(ct.Structure):
    _fields_ = (("logger", _LOGGER), ("allocate", ct.c_void_p), ("free", ct.c_void_p), ("finished", ct.c_void_p),
                ("environment", ct.c_void_p))


class Fmu:
    """An unpacked FMU: its description and its loaded library."""

    def __init__(self, folder: str) -> None:
        self.folder = pathlib.Path(folder)
        root = ET.parse(self.folder / "modelDescription.xml").getroot()
        self.version = root.attrib["fmiVersion"]
        self.elements: dict[str, tuple[int, int]] = {}  # index in an array, and the array's number of elements
        self.arrays: dict[str, tuple[str, int, int]] = {}  # type, value reference, number of elements
        self.references: dict[str, int] = {}
        self.kinds: dict[str, str] = {}
        self.outputs: list[str] = []
        (self._read if self.version == "2.0" else self._read_3)(root)
        identifier = root.find("CoSimulation").attrib["modelIdentifier"]  # type: ignore[union-attr]
        system, tuple_, suffix = {"Linux": ("linux64", "x86_64-linux", ".so"),
                                  "Windows": ("win64", "x86_64-windows", ".dll")}[platform.system()]
        binaries = self.folder / "binaries" / (system if self.version == "2.0" else tuple_)
        self.library = ct.CDLL(str(binaries / (identifier + suffix)))
        for name in ("fmi2Instantiate", "fmi3InstantiateCoSimulation", "fmi3InstantiateModelExchange"):
            if name[3] == self.version[0]:
                getattr(self.library, name).restype = ct.c_void_p

    def _read(self, root: ET.Element) -> None:
        self.guid = root.attrib["guid"]
        for v in root.findall("ModelVariables/ScalarVariable"):
            name = v.attrib["name"]
            self.references[name] = int(v.attrib["valueReference"])
            self.kinds[name] = _TYPES.get(v[0].tag, v[0].tag)
            if v.attrib["causality"] == "output":
                self.outputs.append(name)

    def _read_3(self, root: ET.Element) -> None:
        self.guid = root.attrib["instantiationToken"]
        for v in root.find("ModelVariables") or ():
            sizes = [int(d.attrib["start"]) for d in v.findall("Dimension")]
            names = [v.attrib["name"]]
            self.arrays[names[0]] = (_TYPES_3.get(v.tag, v.tag), int(v.attrib["valueReference"]), math.prod(sizes))
            if names[0].startswith("fins."):
                names = [names[0].replace("fins.", f"fin[{fin + 1}].", 1) for fin in range(sizes.pop(0))]
            if sizes:
                names = [f"{name}[{k}]" for name in names for k in range(sizes[0])]
            for k, name in enumerate(names):
                self.references[name] = int(v.attrib["valueReference"])
                self.kinds[name] = _TYPES_3.get(v.tag, v.tag)
                self.elements[name] = k, len(names)
                if v.attrib["causality"] == "output":
                    self.outputs.append(name)


class Instance:
    """An FMU's instance: every call returns its FMI status, `log` collects (status, message)."""

    def __new__(cls, fmu: Fmu, *_: Any, **__: Any) -> Instance:
        return super().__new__(Instance if fmu.version == "2.0" else Instance3)

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
        """Call a function by its name in FMI 2.0 without prefix."""
        status: int = getattr(self.fmu.library, f"fmi2{function}")(self.component, *arguments)
        return status

    def setup(self, start: float = 0.0, stop: float | None = None) -> int:
        return self.call("SetupExperiment", 0, ct.c_double(0.0), ct.c_double(start), int(stop is not None),
                         ct.c_double(stop or 0.0))

    def initialize(self, start: float = 0.0, stop: float | None = None, **values: Any) -> list[int]:
        statuses = [self.setup(start, stop), self.enter()]
        statuses += [self.set(name, value) for name, value in values.items()]
        return [*statuses, self.call("ExitInitializationMode")]

    def enter(self) -> int:
        return self.call("EnterInitializationMode")

    def step(self, time: float, size: float) -> int:
        return self.call("DoStep", ct.c_double(time), ct.c_double(size), 1)

    def run(self, begin: float, end: float, size: float, **inputs: Any) -> int:
        """Step with constant inputs, and return the worst status."""
        worst = max((self.set(name, value) for name, value in inputs.items()), default=OK)
        for k in range(round((end - begin) / size)):
            worst = max(worst, self.step(begin + k * size, size))
        return worst

    def set_vr(self, kind: str, reference: int, value: Any) -> int:
        ctype = _CTYPES[kind]
        return self.call(f"Set{kind}", (ct.c_uint * 1)(reference), ct.c_size_t(1), (ctype * 1)(value))

    def set_reals(self, references: Sequence[int], values: Sequence[float]) -> int:
        """Set scalars in one call."""
        return self.call("SetReal", (ct.c_uint * len(references))(*references), ct.c_size_t(len(references)),
                         (ct.c_double * len(values))(*values))

    def set(self, name: str, value: Any) -> int:
        name = name.replace("__", ".")
        return self.set_vr(self.fmu.kinds[name], self.fmu.references[name], value)

    def get_vr(self, kind: str, references: Sequence[int]) -> tuple[int, list[Any]]:
        ctype = _CTYPES[kind]
        values = (ctype * len(references))()
        status = self.call(f"Get{kind}", (ct.c_uint * len(references))(*references),
                           ct.c_size_t(len(references)), values)
        return status, list(values)

    def read_without_arrays(self, count: int) -> int:
        return self.call("GetReal", None, ct.c_size_t(count), None)

    def get(self, name: str) -> Any:
        status, (value,) = self.get_vr(self.fmu.kinds[name], [self.fmu.references[name]])
        assert status == OK, status
        return value

    def differentiate(self, name: str, order: int, value: float) -> int:
        """Set one input's derivative."""
        return self.call("SetRealInputDerivatives", (ct.c_uint * 1)(self.fmu.references[name]), ct.c_size_t(1),
                         (ct.c_int * 1)(order), (ct.c_double * 1)(value))

    def status(self, kind: str, status_kind: int) -> tuple[int, Any]:
        """Return the status of fmi2Get<kind>Status, and the value."""
        value = _CTYPES[kind](-1)
        return self.call(f"Get{kind}Status", status_kind, ct.byref(value)), value.value

    def debug(self, on: bool, categories: Sequence[str]) -> int:
        names = (ct.c_char_p * len(categories))(*(c.encode() for c in categories))
        return self.call("SetDebugLogging", int(on), ct.c_size_t(len(categories)), names)

    def outputs(self) -> dict[str, Any]:
        return {name: self.get(name) for name in self.fmu.outputs}

    def save(self) -> ct.c_void_p:
        state = ct.c_void_p()
        assert self.call("GetFMUstate", ct.byref(state)) == OK
        return state

    def serialize(self, state: ct.c_void_p) -> bytes:
        size = ct.c_size_t()
        assert self.call("SerializedFMUstateSize", state, ct.byref(size)) == OK
        data = (ct.c_char * size.value)()
        assert self.call("SerializeFMUstate", state, data, size) == OK
        return data.raw

    def restore(self, data: bytes) -> int:
        """Deserialize and set a state, and return the worst status."""
        state = ct.c_void_p()
        buffer = (ct.c_char * len(data)).from_buffer_copy(data)
        status = self.call("DeSerializeFMUstate", buffer, ct.c_size_t(len(data)), ct.byref(state))
        if status == OK:
            status = self.call("SetFMUstate", state)
            self.call("FreeFMUstate", ct.byref(state))
        return status

    def free(self) -> None:
        self.fmu.library.fmi2FreeInstance(self.component)

    def messages(self, status: int) -> str:
        return "\n".join(message for its_status, message in self.log if its_status == status)


class Instance3(Instance):
    """An instance of an FMI 3.0 FMU."""

    def __init__(self, fmu: Fmu, name: str = "fin", guid: str | None = None, logging: bool = True, kind: int = 1,
                 event_mode: bool = False, early_return: bool = False) -> None:
        self.fmu = fmu
        self.log = []
        self._logger = _LOGGER_3(lambda _, status, __, message: self.log.append((status, message.decode())))
        self._start = 0.0
        self._stop: float | None = None
        identity = (name.encode(), (guid or fmu.guid).encode(), None, ct.c_bool(False), ct.c_bool(logging))
        if kind == 0:
            pointer = fmu.library.fmi3InstantiateModelExchange(*identity, None, self._logger)
        else:
            pointer = fmu.library.fmi3InstantiateCoSimulation(
                *identity, ct.c_bool(event_mode), ct.c_bool(early_return), None, ct.c_size_t(0), None, self._logger,
                None)
        self.component = ct.c_void_p(pointer)
        self.event_needed, self.returned_early, self.reached = False, False, 0.0  # results of the last step

    def call(self, function: str, *arguments: Any) -> int:
        name = function.replace("FMUstate", "FMUState").replace("DeSerialize", "Deserialize")
        status: int = getattr(self.fmu.library, f"fmi3{name}")(self.component, *arguments)
        return status

    def setup(self, start: float = 0.0, stop: float | None = None) -> int:
        self._start, self._stop = start, stop
        return OK

    def enter(self) -> int:
        return self.call("EnterInitializationMode", ct.c_bool(False), ct.c_double(0.0), ct.c_double(self._start),
                         ct.c_bool(self._stop is not None), ct.c_double(self._stop or 0.0))

    def step(self, time: float, size: float) -> int:
        event, end, early, reached = ct.c_bool(), ct.c_bool(), ct.c_bool(), ct.c_double()
        status = self.call("DoStep", ct.c_double(time), ct.c_double(size), ct.c_bool(True), ct.byref(event),
                           ct.byref(end), ct.byref(early), ct.byref(reached))
        self.event_needed, self.returned_early, self.reached = event.value, early.value, reached.value
        return status

    def update(self) -> int:
        """Return the status of fmi3UpdateDiscreteStates, which must request nothing more."""
        flags = [ct.c_bool(True) for _ in range(5)]
        status = self.call("UpdateDiscreteStates", *map(ct.byref, flags), ct.byref(ct.c_double()))
        assert not any(flag.value for flag in flags)
        return status

    def set_vr(self, kind: str, reference: int, value: Any) -> int:
        ctype, kind = self._typed(kind)
        values = value if isinstance(value, list) else [value]
        return self.call(f"Set{kind}", (ct.c_uint * 1)(reference), ct.c_size_t(1), (ctype * len(values))(*values),
                         ct.c_size_t(len(values)))

    def set_reals(self, references: Sequence[int], values: Sequence[float]) -> int:
        return self.call("SetFloat64", (ct.c_uint * len(references))(*references), ct.c_size_t(len(references)),
                         (ct.c_double * len(values))(*values), ct.c_size_t(len(values)))

    def set(self, name: str, value: Any) -> int:
        name = name.replace("__", ".")
        if name not in self.fmu.elements:  # a whole array
            kind, reference, count = self.fmu.arrays[name]
            return self.set_vr(kind, reference, value if isinstance(value, list) else [value] * count)
        element, count = self.fmu.elements[name]
        kind, reference, values = self.fmu.kinds[name], self.fmu.references[name], [value]
        if count > 1:
            status, values = self.get_elements(kind, reference, count)
            assert status == OK
            values[element] = value
        return self.set_vr(kind, reference, values)

    def get_elements(self, kind: str, reference: int, count: int) -> tuple[int, list[Any]]:
        """Return the status, and the values of an array."""
        ctype, kind = self._typed(kind)
        values = (ctype * count)()
        status = self.call(f"Get{kind}", (ct.c_uint * 1)(reference), ct.c_size_t(1), values, ct.c_size_t(count))
        return status, list(values)

    def get_vr(self, kind: str, references: Sequence[int]) -> tuple[int, list[Any]]:
        ctype, kind = self._typed(kind)
        count = len(references)
        values = (ctype * count)()
        status = self.call(f"Get{kind}", (ct.c_uint * count)(*references), ct.c_size_t(count), values,
                           ct.c_size_t(count))
        return status, list(values)

    def get(self, name: str) -> Any:
        element, count = self.fmu.elements[name]
        status, values = self.get_elements(self.fmu.kinds[name], self.fmu.references[name], count)
        assert status == OK, status
        return values[element]

    def read_without_arrays(self, count: int) -> int:
        return self.call("GetFloat64", None, ct.c_size_t(count), None, ct.c_size_t(count))

    def debug(self, on: bool, categories: Sequence[str]) -> int:
        names = (ct.c_char_p * len(categories))(*(c.encode() for c in categories))
        return self.call("SetDebugLogging", ct.c_bool(on), ct.c_size_t(len(categories)), names)

    def free(self) -> None:
        self.fmu.library.fmi3FreeInstance(self.component)

    @staticmethod
    def _typed(kind: str) -> tuple[Any, str]:
        kind = {"Real": "Float64", "Integer": "Int32"}.get(kind, kind)
        return (ct.c_bool if kind == "Boolean" else _CTYPES[kind]), kind
