"""Fixtures shared by all tests."""

from __future__ import annotations

import gc
import os
import shutil
import signal

# Set before NumPy is imported. Each worker has one core: threads of the linear algebra that wait for each other on busy
# cores take a hundred times as long as these small matrices. Workers and programs that tests start inherit it.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# A background process ignores Ctrl-C, and the programs that tests start and interrupt would inherit that.
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
from emcas_fmu.fmi import pictures
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.runtime import compiler, library
from emcas_fmu.runtime.compiler import local_platform

ShippedUnit = Callable[..., Path]
_DRAWN = plots.svg, pictures.response_pictures
Once = Callable[[str, Callable[[Path], object]], Path]

# No deadline: the time of an example depends on the machine and its load.
settings.register_profile("emcas", deadline=None, max_examples=50)
settings.load_profile("emcas")


def pytest_configure(config: pytest.Config) -> None:
    """Compile kernels of extended and users' actuators without optimisation, unless slow tests run.

    The bits are the same, and compiling takes a fifth of the time. Slow tests run kernels for longer than that saves.
    """
    def by_model(function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapper(*arguments: Any) -> Any:
            model, lanes = arguments[-2:]
            with pytest.MonkeyPatch.context() as patch:
                if lanes == 1 and model not in NAMES:
                    leave_unoptimised(patch)
                return function(*arguments)

        return wrapper

    if "not slow" in config.option.markexpr:
        library._digest, library._compile = by_model(library._digest), by_model(library._compile)


def leave_unoptimised(patch: pytest.MonkeyPatch) -> None:
    """Compile kernels of single actuators without optimisation."""
    patch.setitem(library._VECTOR_FLAGS, 1, ("-O0",))


def pytest_collection_finish() -> None:
    """Exclude the objects that all tests share from garbage collection, and collect the others less often.

    Traced programs are a million objects without garbage; scanning them a hundred times takes a third of the time of
    tracing.
    """
    gc.freeze()
    gc.set_threshold(50_000, 10, 100)


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip a test of a compiled kernel without a compiler; at the test's start, since the check compiles the kernel."""
    for mark in item.iter_markers("kernel"):
        if not library.available(*mark.args):
            pytest.skip("no C compiler")


@pytest.fixture(scope="session", autouse=True)
def _names_parsed_once() -> Iterator[None]:
    """Cache fmpy's parsing of variable names: each takes milliseconds, and hundreds of FMUs have the same names."""
    parse, trees = Lark.parse, dict[tuple[str, str], Any]()

    def once(self: Lark, text: str) -> Any:
        if (self.source_grammar, text) not in trees:
            trees[self.source_grammar, text] = parse(self, text)
        return trees[self.source_grammar, text]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Lark, "parse", once)
        yield


@pytest.fixture(autouse=True)
def _no_pictures(request: pytest.FixtureRequest) -> Iterator[None]:
    """Plot pictures only in tests marked `drawn`, and in fixtures of a module or session."""
    with pytest.MonkeyPatch.context() as patch:
        if not request.node.get_closest_marker("drawn"):
            leave_undrawn(patch)
        yield


def leave_undrawn(patch: pytest.MonkeyPatch) -> None:
    """Plot the figures of pages without writing them, which saves a third of a second each; leave them out of FMUs."""
    def empty(_: Figure, label: str = "", __: str = "") -> str:
        return f'<svg role="img" aria-label="{escape(label)}" viewBox="0 0 1 1"></svg>'

    patch.setattr(plots, "svg", empty)
    patch.setattr(pictures, "response_pictures", lambda _: ())


@pytest.fixture
def unoptimised(monkeypatch: pytest.MonkeyPatch) -> None:
    """Compile kernels without optimisation: for slow tests that run each for less time than optimising takes."""
    leave_unoptimised(monkeypatch)


@pytest.fixture(scope="session")
def values() -> Mapping[str, Any]:
    """The values of the shipped parameters by name, in SI units."""
    return load_parameters().values


@pytest.fixture(scope="session")
def once(tmp_path_factory: pytest.TempPathFactory) -> Once:
    """Return a function that fills a named folder once for all processes of a test run, and returns its path."""
    base = tmp_path_factory.getbasetemp()
    common = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "once"
    common.mkdir(exist_ok=True)

    def folder_of(name: str, make: Callable[[Path], object]) -> Path:
        folder = common / name
        with FileLock(f"{folder}.lock"):
            if not folder.is_dir():
                unfinished = Path(f"{folder}.unfinished")
                shutil.rmtree(unfinished, ignore_errors=True)  # of a failed attempt
                unfinished.mkdir()
                make(unfinished)
                unfinished.rename(folder)
        return folder

    return folder_of


@pytest.fixture(scope="session")
def shipped_unit(once: Once) -> ShippedUnit:
    """Return a function that builds an FMU of the shipped parameters, native for this platform or for all.

    FMUs of several fins and with flat names are compiled without optimisation: the same bits, in less time. All have
    pictures, whichever test builds them first.
    """
    local = local_platform()

    def built(backend: str = "native", fins: int = 1, fmi: str = "2", names: str = "structured",
             everywhere: bool = False) -> Path:
        assert local is not None
        platforms = [local.name] if backend == "native" and not everywhere else None
        file = "EMCAS.fmu" if fins == 1 else f"EMCAS{fins}.fmu"

        def make(folder: Path) -> None:
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr(plots, "svg", _DRAWN[0])
                patch.setattr(pictures, "response_pictures", _DRAWN[1])
                if fins > 1 or names != "structured":
                    patch.setattr(compiler, "FLAGS", (*compiler.FLAGS, "-O0"))
                build(load_parameters(), folder / file, backend, platforms, fins=fins, fmi=fmi, names=names)

        return once(f"{backend}_{fins}_{fmi}_{names}_{everywhere}", make) / file

    return built


@pytest.fixture(scope="session")
def fmu(shipped_unit: ShippedUnit) -> Path:
    """EMCAS.fmu of the shipped parameters, with the Python back end."""
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
    """The Python and the native FMU by back end."""
    return {"python": fmu, "native": native}
