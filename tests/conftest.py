"""Fixtures shared by all tests."""

from __future__ import annotations

import gc
import os
import shutil
import signal

# Before NumPy comes: a worker has a core, and threads of the linear algebra that wait for each other on cores that
# others use take a hundred times what these small matrices do. Workers and programs that tests start have it, too.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# What is started in the background ignores Ctrl-C, and so would the programs that tests start, and interrupt.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

from collections.abc import Callable, Iterator, Mapping
from html import escape
from pathlib import Path
from typing import Any

import pytest
from filelock import FileLock
from hypothesis import settings
from lark import Lark
from matplotlib.figure import Figure

from emcas_fmu.actuators import NAMES
from emcas_fmu.figures import plots
from emcas_fmu.fmi import figures
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import compiler, library
from emcas_fmu.runtime.compiler import local_platform

ShippedUnit = Callable[..., Path]
_DRAWN = plots.svg, figures.response_pictures
Once = Callable[[str, Callable[[Path], object]], Path]

# How long an example takes is the machine's, and of whatever else it runs.
settings.register_profile("emcas", deadline=None, max_examples=50)
settings.load_profile("emcas")


def pytest_configure(config: pytest.Config) -> None:
    """Compile kernels without optimisation, unless slow tests run: those of extended and users' actuators.

    The bits are the same, and compiling takes a fifth of the time. Slow tests run them for longer than that saves.
    """
    def by_model(function: Callable[..., Any]) -> Callable[..., Any]:
        def called(*arguments: Any) -> Any:
            model, lanes = arguments[-2:]
            with pytest.MonkeyPatch.context() as patch:
                if lanes == 1 and model not in NAMES:
                    leave_unoptimised(patch)
                return function(*arguments)

        return called

    if "not slow" in config.option.markexpr:
        library._digest, library._compile = by_model(library._digest), by_model(library._compile)


def leave_unoptimised(patch: pytest.MonkeyPatch) -> None:
    """Compile kernels of single actuators without optimisation."""
    patch.setitem(library._VECTOR_FLAGS, 1, ("-O0",))


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over what all tests share, and look at the rest more seldom.

    Traced programs are a million objects without garbage, over which it otherwise goes a hundred times: a third of the
    time of tracing.
    """
    gc.freeze()
    gc.set_threshold(50_000, 10, 100)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test of a compiled kernel where none can be had; asked when the test is due, since it compiles one."""
    for mark in item.iter_markers("kernel"):
        if not library.available(*mark.args):
            pytest.skip("no C compiler")


@pytest.fixture(scope="session", autouse=True)
def _names_parsed_once() -> Iterator[None]:
    """Keeps what the parser that fmpy uses made of names: each takes milliseconds, and hundreds of units share most."""
    parse, trees = Lark.parse, dict[tuple[str, str], Any]()

    def once(self: Lark, text: str) -> Any:
        if (self.source_grammar, text) not in trees:
            trees[self.source_grammar, text] = parse(self, text)
        return trees[self.source_grammar, text]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Lark, "parse", once)
        yield


@pytest.fixture(autouse=True)
def _undrawn(request: pytest.FixtureRequest) -> Iterator[None]:
    """Draw pictures in tests marked `drawn` alone, and in fixtures of a module or session."""
    with pytest.MonkeyPatch.context() as patch:
        if not request.node.get_closest_marker("drawn"):
            leave_undrawn(patch)
        yield


def leave_undrawn(patch: pytest.MonkeyPatch) -> None:
    """Leave pictures out: those of pages are plotted, but not laid out and written, a third of a second each.

    FMUs have none on their pages.
    """
    def empty(_: Figure, label: str = "", __: str = "") -> str:
        return f'<svg role="img" aria-label="{escape(label)}" viewBox="0 0 1 1"></svg>'

    patch.setattr(plots, "svg", empty)
    patch.setattr(figures, "response_pictures", lambda _: ())


@pytest.fixture
def unoptimised(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile kernels without optimisation: for slow tests that run each for less time than that saves."""
    leave_unoptimised(monkeypatch)


@pytest.fixture(scope="session")
def values() -> Mapping[str, Any]:
    """The shipped parameters, flat, in the table's units."""
    return load_parameters().values


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """Gives the folder of a name, which a function makes: once for all processes of a run."""
    base = tmp_path_factory.getbasetemp()
    common = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "once"
    common.mkdir(exist_ok=True)

    def made(name: str, make: Callable[[Path], object]) -> Path:
        folder = common / name
        with FileLock(f"{folder}.lock"):
            if not folder.is_dir():
                begun = Path(f"{folder}.begun")
                shutil.rmtree(begun, ignore_errors=True)  # of an attempt that has failed
                begun.mkdir()
                make(begun)
                begun.rename(folder)
        return folder

    return made


@pytest.fixture(scope="session")
def shipped_unit(once: Once) -> ShippedUnit:
    """Gives the FMU of the shipped parameters, native for this platform or everywhere.

    Units of several fins and those of flat names are compiled without optimisation: the same bits, in less time. All
    have pictures, whichever test is the first to need them.
    """
    local = local_platform()

    def made(backend: str = "native", fins: int = 1, fmi: str = "2", names: str = "structured",
             everywhere: bool = False) -> Path:
        assert local is not None
        platforms = [local.name] if backend == "native" and not everywhere else None
        file = "EMCAS.fmu" if fins == 1 else f"EMCAS{fins}.fmu"

        def make(folder: Path) -> None:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(plots, "svg", _DRAWN[0])
                patch.setattr(figures, "response_pictures", _DRAWN[1])
                if fins > 1 or names != "structured":
                    patch.setattr(compiler, "FLAGS", (*compiler.FLAGS, "-O0"))
                build(load_parameters(), folder / file, backend, platforms, fins=fins, fmi=fmi, names=names)

        return once(f"{backend}_{fins}_{fmi}_{names}_{everywhere}", make) / file

    return made


@pytest.fixture(scope="session")
def fmu(shipped_unit: ShippedUnit) -> Path:
    """EMCAS.fmu of the shipped parameters."""
    return shipped_unit("python")


@pytest.fixture(scope="session")
def native(shipped_unit: ShippedUnit) -> Path:
    """EMCAS.fmu of the shipped parameters, native, for this platform."""
    return shipped_unit()


@pytest.fixture(scope="session")
def native3(shipped_unit: ShippedUnit) -> Path:
    """EMCAS.fmu of the shipped parameters in FMI 3.0, for this platform."""
    return shipped_unit(fmi="3")


@pytest.fixture(scope="session")
def units(fmu: Path, native: Path) -> Mapping[str, Path]:
    """Both FMUs by back end."""
    return {"python": fmu, "native": native}
