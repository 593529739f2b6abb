"""One interface to three hosts that step an SSP archive in a loop.

    with hosts.open(Path("EMCAS.ssp"), "libcosimpy", variant="cold", step=1e-3) as system:
        system.set("fin1.fin_command", 0.1)
        system.set("supply_voltage", 36.0)  # at every component that has this input
        system.step()
        angle = system.get("fin1.fin_angle")

Names are those of the components and their connectors; parameters are those of the variant. An input acts from the next
step on; an output is that at the end of the last step. In all three hosts a signal from one component to another
arrives one step later. Connectors of the system itself are ignored.
"""

from __future__ import annotations

import importlib
import zipfile
from abc import ABC, abstractmethod
from collections.abc import Mapping
from io import BytesIO
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import Any

from lxml import etree

from emcas_fmu.parameters import Scalar
from emcas_fmu.runtime.compiler import local_platform
from emcas_fmu.ssp.archive import (
    DEFAULT,
    NAMESPACES,
    NOMINAL,
    SspError,
    parse,
    read_archive,
    structure_files,
    write_archive,
)
from emcas_fmu.ssp.check import check
from emcas_fmu.ssp.structure import SystemStructure, nearest, read_variant

# Python packages of the hosts, each with its module here and the command that installs it.
HOSTS = {"fmpy": ("in_fmpy", "pip install fmpy"), "libcosimpy": ("in_libcosim", "pip install libcosimpy"),
         "ecospy": ("in_ecos", "pip install ecospy; on Debian also apt-get install libtbb12")}
End = tuple[str, str]  # component and variable


class System(ABC):
    """A running system, as a context manager; `step_size` is in s, values are in the connectors' units."""

    def __init__(self, structure: SystemStructure, step: float) -> None:
        self.step_size, self.steps, self._closed = step, 0, False
        self._inputs: dict[str, list[End]] = {}
        self._outputs: dict[str, End] = {}
        self._inner = [(start, end) for start, end in structure.connections if start[0] and end[0]]
        self._pending: dict[End, Scalar] = {}
        self._withheld: dict[str, str] = {}  # reason, by the name of an output that the host cannot read
        fed = {end for _, end in self._inner}
        for end, connector in structure.connectors.items():
            component, name = end
            if component and connector.kind == "output":
                self._outputs[f"{component}.{name}"] = end
            elif component and connector.kind == "input" and end not in fed:
                self._inputs[f"{component}.{name}"] = [end]
                self._inputs.setdefault(name, []).append(end)

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs."""
        return tuple(self._inputs)

    @property
    def outputs(self) -> tuple[str, ...]:
        """Names of the outputs that this host can read."""
        return tuple(name for name in self._outputs if name not in self._withheld)

    @property
    def time(self) -> float:
        """The current time [s]."""
        return self.steps * self.step_size

    def set(self, name: str, value: Scalar) -> None:
        """Set an input, such as ``fin1.fin_command``, from the next step on.

        A name without a component, such as ``supply_voltage``, sets this input of every component that has it. Raises
        SspError for an unknown input, and for a value that is not finite.
        """
        if name not in self._inputs:
            raise SspError(f"the system has no input {name!r}; {nearest(name, self._inputs, 'see inputs')}")
        if not isfinite(value):  # an FMU refuses it, and Ecos ignores the refusal
            raise SspError(f"{name} = {value}: must be finite")
        for end in self._inputs[name]:
            self._pending[end] = value

    def step(self) -> None:
        """Step once. Raises SspError if a component refuses."""
        if self._closed:
            raise SspError("the system is closed; open it again")
        pending, self._pending = self._pending, {}
        self._advance(pending)
        self.steps += 1

    def get(self, name: str) -> Scalar:
        """Return an output at the end of the last step. Raises SspError if it is unknown, or before the first step."""
        if name in self._withheld:
            raise SspError(f"{name}: {self._withheld[name]}")
        if name not in self._outputs:
            raise SspError(f"the system has no output {name!r}; {nearest(name, self._outputs, 'see outputs')}")
        if self._closed:
            raise SspError("the system is closed; read before closing it")
        if self.steps == 0:
            raise SspError(f"{name} is not known before the first step: libcosim initializes within it")
        return self._read(*self._outputs[name])

    def close(self) -> None:
        """Free all resources; may be called again."""
        if not self._closed:
            self._closed = True
            self._free()

    def __enter__(self) -> System:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()

    @abstractmethod
    def _advance(self, pending: dict[End, Scalar]) -> None:
        """Set values at components, then step. Raises SspError."""

    @abstractmethod
    def _read(self, component: str, variable: str) -> Scalar:
        """Return the value of a component's variable."""

    @abstractmethod
    def _free(self) -> None:
        """Free the host's resources; called once."""


def open(ssp: Path, host: str, variant: str = NOMINAL, step: float = 1e-3) -> System:
    """Load a variant of an archive into a host with a fixed step [s], ready for its first step.

    Raises SspError if the host is unknown or not installed, if the archive does not pass `check` or has no such
    variant, and if the host refuses.
    """
    if host not in HOSTS:
        raise SspError(f"there is no host {host!r}; there is {', '.join(HOSTS)}")
    if not 0.0 < step < float("inf"):
        raise SspError(f"step {step}: must be above 0")
    module_name, installation = HOSTS[host]
    try:
        importlib.import_module(host)
    except (ImportError, OSError) as error:  # OSError: a library it needs
        raise SspError(f"{host} cannot be loaded ({error}): {installation}") from error
    # Hosts do not report most errors.
    if errors := check(ssp).errors:
        raise SspError("\n".join(f"{ssp}: {error}" for error in errors))
    contents = read_archive(ssp)
    structure = read_variant(ssp, variant)
    _runnable(contents, structure)
    with TemporaryDirectory() as folder:
        prepared = Path(folder) / "system.ssp"
        write_archive(_prepared(contents, structure.file, host), prepared)
        module = importlib.import_module(f".{module_name}", __package__)
        try:
            system: System = module.Running(structure, step, prepared)
        except SspError as error:
            raise SspError(f"{ssp}: {host}: {error}") from error
    return system


def _runnable(contents: Mapping[str, bytes], structure: SystemStructure) -> None:
    """Raise SspError if an FMU has no binary for this platform: Ecos would end the process."""
    local = local_platform()
    for source in sorted(set(structure.sources.values())):
        with zipfile.ZipFile(BytesIO(contents[source])) as fmu:
            there = sorted({name.split("/")[1] for name in fmu.namelist() if name.startswith("binaries/")})
        if local is not None and local.name not in there:
            raise SspError(f"{source} has binaries for {', '.join(there) or 'no platform'} only, and this is "
                           f"{local.name}; build it with emcas build --backend native, then emcas ssp --fmu")


def _prepared(archive: Mapping[str, bytes], file: str, host: str) -> dict[str, bytes]:
    """Return the archive with one variant as SystemStructure.ssd, the only structure that all three hosts open.

    For libcosim and Ecos, connections of the system's own connectors are removed, which they refuse; for libcosim also
    connectors of enumerations. Raises SspError for libcosim if an enumeration is connected.
    """
    others = set(structure_files(archive)) - {file}
    contents = {name: data for name, data in archive.items() if name not in others}
    root = parse(contents.pop(file), file)
    if host != "fmpy":
        for connection in root.findall("ssd:System/ssd:Connections/ssd:Connection", NAMESPACES):
            if not (connection.get("startElement") and connection.get("endElement")):
                connection.getparent().remove(connection)
    if host == "libcosimpy":
        _without_enumerations(root, file)
    contents[DEFAULT] = etree.tostring(root, xml_declaration=True, encoding="UTF-8")
    return contents


def _without_enumerations(root: Any, file: str) -> None:
    """Remove connectors of enumerations, at which libcosim ends the process. Raises SspError if one is connected."""
    gone = set()
    for enumeration in root.findall(".//ssd:Component/ssd:Connectors/ssd:Connector/ssc:Enumeration", NAMESPACES):
        connector = enumeration.getparent()
        connectors = connector.getparent()
        gone.add((connectors.getparent().get("name"), connector.get("name")))
        connectors.remove(connector)
    for connection in root.findall("ssd:System/ssd:Connections/ssd:Connection", NAMESPACES):
        ends = [(connection.get(f"{side}Element"), connection.get(f"{side}Connector")) for side in ("start", "end")]
        if gone.intersection(ends):
            raise SspError(f"{file}: connection {' -> '.join('.'.join(map(str, end)) for end in ends)} is of an "
                           "enumeration, which libcosim does not support; wire an Integer, or use fmpy")
