"""Machine code of an actuator, compiled on first use and kept in the user's cache."""

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

from ..actuators import NONLINEAR, is_shipped, parts
from ..errors import EmcasError, in_words
from ..support.files import cache_directory
from ..support.progress import LOG, announce
from ..support.writing import write
from .c_sources import batch_sources, vector_sources
from .compiler import FLAGS, Compiler, CompilerError, Platform, local_compilers, local_platform

# Flags by the number of actuators in a vector. Unlike a host of an FMU, Python never traps floating-point exceptions.
_VECTOR_FLAGS = {8: ("-fno-trapping-math", "-mavx512f", "-mavx512dq"), 4: ("-fno-trapping-math", "-mavx2")}
# Numbers of steps of 1 ms from which compiling saves time: instead of Python, and for vectors instead of one at a time.
WORTH_COMPILING, WORTH_VECTORS = 10_000, 20_000_000
# Numbers of steps from which looking for a compiled library saves time, though its source must be printed first.
_WORTH_LOOKING = {WORTH_COMPILING: 1000, WORTH_VECTORS: 200_000}

# Prototypes of exported functions in a library's sources: result, name and arguments.
_PROTOTYPE = re.compile(r"^API (\w+) (\w+)\(([^)]*)\)", re.MULTILINE)
_C_TYPES: Mapping[str, Any] = {"void": None, "int": ct.c_int, "size_t": ct.c_size_t, "uint64_t": ct.c_uint64,
                               "double": ct.c_double}
_loading = threading.Lock()
_steps: dict[tuple[str, int], float] = defaultdict(float)  # in this process, by model and lanes


@cache
def _sources(model: str, lanes: int) -> Mapping[str, str]:
    return vector_sources(model) if lanes > 1 else batch_sources(model)


def _digest(compiler: Compiler, target: Platform, model: str, lanes: int) -> str:
    """Return a hash of everything that a library depends on."""
    sources = sorted(_sources(model, lanes).items())
    text = "\0".join([target.name, *FLAGS, *_VECTOR_FLAGS.get(lanes, ()), *(f"{n}\0{t}" for n, t in sources)])
    return hashlib.sha256(f"{compiler.version}\0{text}".encode()).hexdigest()[:20]


@cache
def _library(model: str, lanes: int = 1) -> ct.CDLL | str:
    """Return the compiled library of a model, for vectors if `lanes` is above 1, or the reason why there is none."""
    target = local_platform()
    if target is None:
        return "this platform is not known"
    problem = ""
    for compiler in local_compilers():
        if lanes > 1 and target.name == "win64" and not compiler.zig:
            continue  # gcc does not align the stack for vectors there
        digest = _digest(compiler, target, model, lanes)
        try:
            path = _cached(digest, model) or _compile(compiler, target, digest, model, lanes)
            return _with_types(ct.CDLL(str(path)), "\n".join(_sources(model, lanes).values()))
        except (OSError, CompilerError) as error:
            problem = str(error)
        except EmcasError as error:  # the cache cannot be written, whichever compiler is used
            problem = str(error)
            break
    if problem:
        used = "one actuator at a time" if lanes > 1 else "Python"
        announce(f"no compiled kernel, {used} is used instead: {problem}")
    return problem or "install a C compiler, or ziglang with  pip install 'emcas-fmu[native]'"


def worth(model: str, steps: float, lanes: int = 1) -> bool:
    """Return whether compiling a model saves time over `steps` additional steps of 1 ms.

    With `lanes` above 1 it is compiled for vectors. Compiling saves time after enough steps in this process, or earlier
    if a compiled library is in the cache. With one lane a user's actuator is always compiled: it may divide by zero in
    an unused result, which raises an error in Python.
    """
    if lanes == 1 and not is_shipped(model):
        return True
    key, threshold = (model, lanes), WORTH_VECTORS if lanes > 1 else WORTH_COMPILING
    _steps[key] += steps
    if _WORTH_LOOKING[threshold] <= _steps[key] < threshold and _is_cached(model, lanes):
        _steps[key] += threshold  # no need to look again
    return _steps[key] >= threshold


def milliseconds(points: float, step: float) -> float:
    """Return the number of steps of 1 ms that take as long as `points` steps of `step` [s], at least `points`."""
    return points * max(step / 1e-3, 1.0)


def _is_cached(model: str, lanes: int) -> bool:
    """Return whether a library has been compiled on this machine before."""
    target = local_platform()
    if target is None or next(_files(model), None) is None:  # printing the source for the digest is slow
        return False
    return any(_cached(_digest(compiler, target, model, lanes), model) for compiler in local_compilers())


def _files(model: str, digest: str = "*") -> Iterator[Path]:
    """Yield a model's libraries in the user's cache, all or those with a digest; none without a cache."""
    try:
        yield from cache_directory().glob(f"kernel_{_label(model)}_{digest}_*")
    except OSError:
        return


def _label(model: str) -> str:
    """Return a model's label in file names; models from several users' files may have the same label."""
    actuator, extensions = parts(model)
    return re.sub(r"[^\w+-]", "", "+".join((Path(actuator).stem, *extensions)))[:60]


def loaded(model: str) -> ct.CDLL:
    """Return the library of a model, compiled if necessary. Raises CompilerError if it cannot be compiled."""
    with _loading:  # several threads may need it first
        library = _library(model)
    if isinstance(library, str):
        raise CompilerError(f"no compiled kernel: {library}")
    return library


def vectors(model: str, steps: float, lanes: int | None = None) -> ct.CDLL | None:
    """Return the library that steps several actuators of a model at once, if compiling saves time over `steps` of 1 ms.

    Returns None if it does not, or if there is no library for vectors. `lanes` is the number of actuators in a vector,
    1 (None), 4 or 8, by default as many as the processor allows. Raises ValueError for others and for more than these,
    CompilerError if nothing can be compiled.
    """
    most = loaded(model).actuator_lanes()
    lanes = most if lanes is None else lanes
    if lanes not in (1, *_VECTOR_FLAGS):
        raise ValueError(f"{lanes} actuators in a vector: only 1, 4 and 8 are possible")
    if lanes > most:
        raise ValueError(f"vectors of this processor hold {most} numbers, not {lanes}")
    if lanes not in _VECTOR_FLAGS or not worth(model, steps, lanes):
        return None
    with _loading:
        library = _library(model, lanes)
    return None if isinstance(library, str) else library


def compile_for(model: str, steps: float) -> None:
    """Compile the libraries that save time over `steps` of 1 ms, before several processes compile them."""
    if available(model):
        vectors(model, steps)


def available(model: str = NONLINEAR) -> bool:
    """Return whether this machine has a compiled kernel of a model; compile it if necessary."""
    try:
        loaded(model)
    except CompilerError:
        return False
    return True


def _cached(digest: str, model: str) -> Path | None:
    """Return the undamaged library in the cache, or None; delete damaged ones. A hash of the content is in the name."""
    for path in _files(model, digest):
        if path.stem.endswith(hashlib.sha256(path.read_bytes()).hexdigest()[:16]):
            return path
        path.unlink(missing_ok=True)
    return None


def _compile(compiler: Compiler, target: Platform, digest: str, model: str, lanes: int) -> Path:
    LOG.info(f"compiling the actuator {model}{' for many at once' if lanes > 1 else ''} (once, up to a minute) ...")
    sources = _sources(model, lanes)
    content = compiler.library(sources, next(iter(sources)), target, "kernel", _VECTOR_FLAGS.get(lanes, ()))
    # A rebuilt library needs another path: a process that has loaded the old one would get the old one again.
    name = f"kernel_{_label(model)}_{digest}_{hashlib.sha256(content).hexdigest()[:16]}{target.suffix}"
    try:
        path = cache_directory() / name
    except OSError as error:
        raise EmcasError(in_words(error)) from error
    write(path, content)
    return path


def _with_types(library: ct.CDLL, sources: str) -> ct.CDLL:
    """Return the library after setting its functions' types from the prototypes in its sources; pointers are void."""
    for result, name, arguments in _PROTOTYPE.findall(sources):
        function = getattr(library, name)
        function.restype = _C_TYPES[result]
        function.argtypes = [ct.c_void_p if "*" in argument else _C_TYPES[argument.split()[0]]
                             for argument in arguments.split(",") if argument != "void"]
    return library
