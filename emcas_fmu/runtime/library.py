"""The kernel and its stepping as machine code, compiled on first use and kept in the user's cache."""

from __future__ import annotations

import ctypes as ct
import hashlib
import threading
import warnings
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from tempfile import NamedTemporaryFile

from ..actuators import NONLINEAR
from ..compiler import FLAGS, Compiler, CompilerError, Platform, local_compilers, local_platform
from ..files import cache_directory
from ..progress import LOG
from .c_sources import core_sources, handwritten, vector_sources

_ONE, _MANY = "batch.c", "vectors.c"
# By the actuators that a vector holds. No host's traps are on in Python, which is what FLAGS think of.
_VECTOR_FLAGS = {8: ("-fno-trapping-math", "-mavx512f", "-mavx512dq"), 4: ("-fno-trapping-math", "-mavx2")}
# Steps of an actuator that are worth compiling for: a vector saves some tenths of a microsecond of each, and compiling
# takes some ten seconds, once.
WORTH = 1_000_000

_DOUBLES = ct.POINTER(ct.c_double)
_SIMULATE = [ct.c_size_t, ct.c_double, ct.c_size_t, ct.c_void_p, ct.c_void_p, ct.c_size_t, ct.c_void_p, ct.c_void_p]
_making = threading.Lock()


@cache
def _library(model: str, lanes: int = 1) -> ct.CDLL | str:
    """Return the compiled library of a model, of vectors if `lanes` is above 1, or why there is none.

    Warns if a compiler was tried.
    """
    target = local_platform()
    if target is None:
        return "this platform is not known"
    main, sources, flags = _ONE, core_sources(model=model), _VECTOR_FLAGS.get(lanes, ())
    if lanes > 1:
        main, sources = _MANY, {**sources, **vector_sources(model)}
    sources = {main: handwritten(main), "tables.h": handwritten("tables.h"), **sources}
    text = "\0".join([target.name, *FLAGS, *flags, *(f"{n}\0{t}" for n, t in sorted(sources.items()))])
    problem = ""
    for compiler in local_compilers():
        described = hashlib.sha256(f"{compiler.version}\0{text}".encode()).hexdigest()[:20]
        try:
            path = _cached(described, target.suffix) or _compile(compiler, sources, target, described, model, flags)
            return (_declared_vectors if lanes > 1 else _declared)(ct.CDLL(str(path)))
        except (OSError, CompilerError) as error:
            problem = str(error)
    if problem:
        warnings.warn(f"no compiled kernel, {'one actuator at a time' if lanes > 1 else 'Python'} is used instead: "
                      f"{problem}", RuntimeWarning, stacklevel=5)
    return problem or "install a C compiler, or ziglang with  pip install 'emcas-fmu[native]'"


def loaded(model: str) -> ct.CDLL:
    """Return the library of a model; compile it if need be. Raises CompilerError where there is none."""
    with _making:  # the first use may come from several threads
        library = _library(model)
    if isinstance(library, str):
        raise CompilerError(f"no compiled kernel: {library}")
    return library


def vectors(model: str, steps: float = WORTH, lanes: int | None = None) -> ct.CDLL | None:
    """Return the library of a model that moves many actuators at once; compile it if that many `steps` are worth it.

    None where they are not, and on a processor without vectors of four numbers. `lanes`, unless given, are as many as
    the processor's vectors hold. Raises CompilerError where there is no compiled kernel at all.
    """
    lanes = loaded(model).actuator_lanes() if lanes is None else lanes
    if lanes not in _VECTOR_FLAGS or (steps < WORTH and (model, lanes) not in _vectors):
        return None
    with _making:
        library = _library(model, lanes)
    if isinstance(library, str):
        return None
    _vectors.add((model, lanes))
    return library


_vectors: set[tuple[str, int]] = set()


def available(model: str = NONLINEAR) -> bool:
    """Return whether there is a compiled kernel of a model on this machine; compile it if need be."""
    try:
        loaded(model)
    except CompilerError:
        return False
    return True


def _cached(described: str, suffix: str) -> Path | None:
    """Return a library compiled before, if it is still what it was: its content's hash is in its name."""
    for path in cache_directory().glob(f"kernel_{described}_*{suffix}"):
        if path.stem.endswith(hashlib.sha256(path.read_bytes()).hexdigest()[:16]):
            return path
        path.unlink(missing_ok=True)
    return None


def _compile(compiler: Compiler, sources: Mapping[str, str], target: Platform, described: str, model: str,
             flags: tuple[str, ...]) -> Path:
    LOG.info(f"compiling the actuator {model}{' for many at once' if flags else ''} (once, up to a minute) ...")
    # A rebuilt library at the same path would give the old one to a process that has it loaded.
    content = compiler.library(sources, _MANY if flags else _ONE, target, "kernel", flags)
    path = cache_directory() / f"kernel_{described}_{hashlib.sha256(content).hexdigest()[:16]}{target.suffix}"
    with NamedTemporaryFile(dir=path.parent, delete=False) as partial:
        partial.write(content)
    Path(partial.name).replace(path)  # whole or not at all, whoever else is compiling
    return path


def _declared(library: ct.CDLL) -> ct.CDLL:
    library.actuator_size.restype = library.actuator_state.restype = ct.c_size_t
    library.actuators_run.restype = library.actuators_simulate.restype = ct.c_size_t
    for function in ("bind", "start"):
        getattr(library, f"actuator_{function}").argtypes = [ct.c_void_p, _DOUBLES]
    for function in ("carried", "outputs"):
        getattr(library, f"actuator_{function}").argtypes = [ct.c_void_p, _DOUBLES, _DOUBLES]
    library.actuator_run.argtypes = [ct.c_void_p, ct.c_double, _DOUBLES, _DOUBLES, _DOUBLES]
    library.actuators_run.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_size_t, ct.c_double, ct.c_void_p, ct.c_void_p,
                                      ct.c_void_p, ct.c_size_t, ct.c_void_p]
    library.actuators_simulate.argtypes = [ct.c_size_t, ct.c_void_p, ct.c_size_t, *_SIMULATE]
    return library


def _declared_vectors(library: ct.CDLL) -> ct.CDLL:
    library.batch_values.restype = library.batch_group_size.restype = ct.c_size_t
    library.batch_prepare.restype = library.batch_run.restype = ct.c_size_t
    library.batch_group_size.argtypes = [ct.c_size_t]
    library.batch_prepare.argtypes = [ct.c_size_t, ct.c_void_p, ct.c_size_t, ct.c_void_p, ct.c_void_p]
    library.batch_start.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_size_t]
    library.batch_run.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_size_t, ct.c_double, ct.c_void_p, ct.c_void_p,
                                  ct.c_uint64, ct.c_void_p, ct.c_size_t, ct.c_void_p]
    library.batch_simulate.restype = None
    library.batch_simulate.argtypes = [ct.c_size_t, ct.c_void_p, ct.c_void_p, ct.c_size_t, *_SIMULATE]
    return library
