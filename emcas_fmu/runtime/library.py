"""The kernel and its stepping as machine code, compiled on first use and kept in the user's cache."""

from __future__ import annotations

import ctypes as ct
import hashlib
import re
import threading
from collections import defaultdict
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from ..actuators import NAMES, NONLINEAR, parts
from ..errors import EmcasError, in_words
from ..support.files import cache_directory
from ..support.progress import LOG, warn
from ..support.writing import write
from .c_sources import batch_sources, vector_sources
from .compiler import FLAGS, Compiler, CompilerError, Platform, local_compilers, local_platform

# By the actuators that a vector holds. No host's traps are on in Python, which is what FLAGS think of, and zig.
_VECTOR_FLAGS = {8: ("-fno-trapping-math", "-mavx512f", "-mavx512dq"), 4: ("-fno-trapping-math", "-mavx2")}
# Steps of 1 ms that take about as long as a compiler, once: in Python, and those in which vectors save as much.
WORTH_COMPILING, WORTH_VECTORS = 10_000, 20_000_000
# To look for what has been compiled takes as long as this, since its source is printed first.
_WORTH_LOOKING = {WORTH_COMPILING: 1000, WORTH_VECTORS: 200_000}

_DOUBLES = ct.POINTER(ct.c_double)
# Of points of time, inputs and outputs of whole runs.
_SIMULATE: Any = [ct.c_size_t, ct.c_double, ct.c_size_t, ct.c_void_p, ct.c_void_p, ct.c_size_t, ct.c_void_p,
                  ct.c_void_p]
_making = threading.Lock()


@cache
def _sources(model: str, lanes: int) -> Mapping[str, str]:
    return vector_sources(model) if lanes > 1 else batch_sources(model)


def _described(compiler: Compiler, target: Platform, model: str, lanes: int) -> str:
    """Return a hash of all that a library depends on."""
    sources = sorted(_sources(model, lanes).items())
    text = "\0".join([target.name, *FLAGS, *_VECTOR_FLAGS.get(lanes, ()), *(f"{n}\0{t}" for n, t in sources)])
    return hashlib.sha256(f"{compiler.version}\0{text}".encode()).hexdigest()[:20]


@cache
def _library(model: str, lanes: int = 1) -> ct.CDLL | str:
    """Return the compiled library of a model, of vectors if `lanes` is above 1, or why there is none.

    That is announced if a compiler was tried.
    """
    target = local_platform()
    if target is None:
        return "this platform is not known"
    problem = ""
    for compiler in local_compilers():
        if lanes > 1 and target.name == "win64" and not compiler.zig:
            continue  # gcc does not align the stack for vectors there
        described = _described(compiler, target, model, lanes)
        try:
            path = _cached(described, model) or _compile(compiler, target, described, model, lanes)
            return (_declared_vectors if lanes > 1 else _declared)(ct.CDLL(str(path)))
        except (OSError, CompilerError) as error:
            problem = str(error)
        except EmcasError as error:  # no other compiler's could be kept either
            problem = str(error)
            break
    if problem:
        warn(f"no compiled kernel, {'one actuator at a time' if lanes > 1 else 'Python'} is used instead: {problem}")
    return problem or "install a C compiler, or ziglang with  pip install 'emcas-fmu[native]'"


def worth(model: str, steps: float, lanes: int = 1) -> bool:
    """Return whether to use a model's compiled kernel, of vectors if `lanes` is above 1, for `steps` more of 1 ms.

    It is where so much has been asked for that compiling pays, or less and it has been compiled before. A user's
    actuator is always compiled: it may divide by zero where nothing comes of it, which Python refuses.
    """
    if lanes == 1 and parts(model)[0] not in NAMES:
        return True
    key, least = (model, lanes), WORTH_VECTORS if lanes > 1 else WORTH_COMPILING
    _asked[key] += steps
    if _WORTH_LOOKING[least] <= _asked[key] < least and _kept(model, lanes):
        _asked[key] += least  # no need to look again
    return _asked[key] >= least


def milliseconds(points: float, step: float) -> float:
    """Return how many steps of 1 ms take about as long as `points` of `step` [s]; shorter ones take no less."""
    return points * max(step / 1e-3, 1.0)


_asked: dict[tuple[str, int], float] = defaultdict(float)


def _kept(model: str, lanes: int) -> bool:
    """Return whether a library has been compiled on this machine before."""
    target = local_platform()
    if target is None or next(_files(model), None) is None:  # whether of this version, only its sources tell
        return False
    return any(_cached(_described(compiler, target, model, lanes), model) for compiler in local_compilers())


def _files(model: str, described: str = "*") -> Iterator[Path]:
    """Yield a model's libraries in the user's cache, of all versions or of what is `described`; none without one."""
    try:
        yield from cache_directory().glob(f"kernel_{_label(model)}_{described}_*")
    except OSError:
        return


def _label(model: str) -> str:
    """Return a model's name as one of a file; models of users' files may share it."""
    actuator, extensions = parts(model)
    return re.sub(r"[^\w+-]", "", "+".join((Path(actuator).stem, *extensions)))[:60]


def loaded(model: str) -> ct.CDLL:
    """Return the library of a model; compile it if need be. Raises CompilerError where there is none."""
    with _making:  # the first use may come from several threads
        library = _library(model)
    if isinstance(library, str):
        raise CompilerError(f"no compiled kernel: {library}")
    return library


def vectors(model: str, steps: float, lanes: int | None = None) -> ct.CDLL | None:
    """Return the library of a model that moves many actuators at once, if that many `steps` are worth it.

    None where they are not, and on a processor without vectors of four numbers. `lanes`, unless given, are as many as
    the processor's vectors hold. Raises ValueError for more, CompilerError where there is no compiled kernel at all.
    """
    most = loaded(model).actuator_lanes()
    lanes = most if lanes is None else lanes
    if lanes > most:
        raise ValueError(f"vectors of this processor hold {most} numbers, not {lanes}")
    if lanes not in _VECTOR_FLAGS or not worth(model, steps, lanes):
        return None
    with _making:
        library = _library(model, lanes)
    return None if isinstance(library, str) else library


def compile_for(model: str, steps: float) -> None:
    """Compile what that many steps of a model are worth, before several processes would do so at the same time."""
    if available(model):
        vectors(model, steps)


def available(model: str = NONLINEAR) -> bool:
    """Return whether there is a compiled kernel of a model on this machine; compile it if need be."""
    try:
        loaded(model)
    except CompilerError:
        return False
    return True


def _cached(described: str, model: str) -> Path | None:
    """Return a library compiled before, if it is still what it was: its content's hash is in its name."""
    for path in _files(model, described):
        if path.stem.endswith(hashlib.sha256(path.read_bytes()).hexdigest()[:16]):
            return path
        path.unlink(missing_ok=True)
    return None


def _compile(compiler: Compiler, target: Platform, described: str, model: str, lanes: int) -> Path:
    LOG.info(f"compiling the actuator {model}{' for many at once' if lanes > 1 else ''} (once, up to a minute) ...")
    sources = _sources(model, lanes)
    # A rebuilt library at the same path would give the old one to a process that has it loaded.
    content = compiler.library(sources, next(iter(sources)), target, "kernel", _VECTOR_FLAGS.get(lanes, ()))
    name = f"kernel_{_label(model)}_{described}_{hashlib.sha256(content).hexdigest()[:16]}{target.suffix}"
    try:
        path = cache_directory() / name
    except OSError as error:
        raise EmcasError(in_words(error)) from error
    write(path, content)
    return path


def _declared(library: ct.CDLL) -> ct.CDLL:
    library.actuator_size.restype = library.actuator_state.restype = ct.c_size_t
    library.actuators_run.restype = library.actuators_simulate.restype = ct.c_size_t
    for function in ("bind", "start"):
        getattr(library, f"actuator_{function}").argtypes = [ct.c_void_p, _DOUBLES]
    for function in ("motion_loads", "outputs"):
        getattr(library, f"actuator_{function}").argtypes = [ct.c_void_p, _DOUBLES, _DOUBLES]
    library.actuator_run.argtypes = [ct.c_void_p, ct.c_double, _DOUBLES, _DOUBLES, _DOUBLES]
    library.actuators_run.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_size_t, ct.c_double, ct.c_void_p, ct.c_void_p,
                                      ct.c_void_p, ct.c_size_t, ct.c_void_p]
    library.actuators_simulate.argtypes = [ct.c_size_t, ct.c_void_p, ct.c_size_t, *_SIMULATE]
    return library


def _declared_vectors(library: ct.CDLL) -> ct.CDLL:
    library.batch_values.restype = library.batch_group_size.restype = ct.c_size_t
    library.batch_run.restype = ct.c_size_t
    library.batch_reads.argtypes, library.batch_reads.restype = [ct.c_void_p], None
    library.batch_group_size.argtypes = [ct.c_size_t]
    library.batch_prepare.argtypes = [ct.c_size_t, ct.c_void_p, ct.c_size_t, ct.c_void_p, ct.c_void_p]
    library.batch_start.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_size_t]
    library.batch_run.argtypes = [ct.c_void_p, ct.c_size_t, ct.c_size_t, ct.c_double, ct.c_void_p, ct.c_void_p,
                                  ct.c_uint64, ct.c_void_p, ct.c_size_t, ct.c_void_p]
    library.batch_prepare.restype = library.batch_simulate.restype = None
    library.batch_simulate.argtypes = [ct.c_size_t, ct.c_void_p, ct.c_void_p, ct.c_size_t, *_SIMULATE]
    return library
