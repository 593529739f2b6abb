"""Check the arguments of the Python interface by their annotations, so that a wrong one is an EmcasError."""

from __future__ import annotations

import builtins
import inspect
import os
import reprlib
import sys
from collections import abc
from collections.abc import Callable
from functools import wraps
from numbers import Integral, Real
from pathlib import Path
from types import FunctionType, NoneType, UnionType
from typing import Any, TypeVar, Union, get_args, get_origin

from ..errors import ArgumentError, EmcasError, in_words

T = TypeVar("T", bound=Callable[..., Any])
Test = Callable[[Any], bool]

# What a user is to give; other classes go by their names.
_WORDS = {"bool": "True or False", "int": "a whole number", "float": "a finite number", "str": "text", "Path": "a path",
          "NoneType": "None", "Callable": "a function", "ndarray": "numbers",
          "ParameterSet": "a parameter set (load_parameters() reads one from a file)",
          "Excitation": "one of emcas_fmu.excitations, such as excitations.reference_case('step_plus10')"}
_MOST: Any = sys.float_info.max  # an int may be beyond it
_brief = reprlib.Repr()
_brief.maxstring = _brief.maxother = 60


def checked(target: T) -> T:
    """Return a function, or a class with its public methods, that first checks arguments by their annotations.

    A `float` is finite, text has no zero byte and can be encoded, an array holds numbers, which may not be finite; each
    element of a collection is checked. A wrong argument raises ArgumentError, which names it, its value and what is
    expected; a file that cannot be used raises EmcasError.
    """
    if isinstance(target, type):
        for name, member in list(vars(target).items()):
            if isinstance(member, FunctionType) and (not name.startswith("_") or name in ("__init__", "__getitem__")):
                setattr(target, name, checked(member))
        return target
    tests: _Tests | None = None

    @wraps(target)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal tests
        if tests is None:  # classes that the annotations name may be defined below the function
            tests = _Tests(target)
        for (name, test), given in zip(tests.by_place, args):
            if test is not None and not test(given):
                raise tests.refusal(name, given)
        for name, given in kwargs.items():
            test = tests.by_name.get(name, tests.other)
            if test is not None and not test(given):
                raise tests.refusal(name, given)
        try:
            return target(*args, **kwargs)
        except OSError as error:
            if error.filename is None:  # of no file: what a callback of the caller's raises
                raise
            raise EmcasError(in_words(error)) from error

    return call  # type: ignore[return-value]


class _Tests:
    """Tests of a function's arguments, by place, by name, and of those that ** collects; None where anything goes."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function.__qualname__.removesuffix(".__init__")
        parameters = inspect.signature(function).parameters.values()
        names = _Names(function.__globals__)
        self._kinds = {p.name: eval(p.annotation, {}, names) if isinstance(p.annotation, str) else Any
                       for p in parameters}
        self.by_name = {p.name: _test(self._kinds[p.name]) for p in parameters if p.kind != p.VAR_KEYWORD}
        self._rest = next((self._kinds[p.name] for p in parameters if p.kind == p.VAR_KEYWORD), Any)
        self.other = _test(self._rest)
        self.by_place = [(p.name, self.by_name[p.name]) for p in parameters
                         if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]

    def refusal(self, name: str, given: Any) -> ArgumentError:
        """Return the error of a wrong argument."""
        return ArgumentError(f"{self._function}: {name} = {brief(given)}: expected "
                             f"{_words(self._kinds.get(name, self._rest))}")


def brief(given: Any) -> str:
    """Return what is given as a line of a message, shortened."""
    return " ".join(_brief.repr(given).split())


class _Names(dict[str, Any]):
    """Names that annotations may have; one that is imported for typing alone is a class known by its name."""

    def __missing__(self, name: str) -> type:
        return getattr(builtins, name, None) or _ByName(name, (), {})


class _ByName(type):
    """Of a class that is not imported here: an object is one if its class, or one above, is called so."""

    def __instancecheck__(cls, given: Any) -> bool:
        return any(each.__name__ == cls.__name__ for each in type(given).__mro__)


def _test(kind: Any) -> Test | None:
    """Return the test of an annotation; None where anything goes."""
    origin, of = get_origin(kind) or kind, get_args(kind)
    if origin in (Union, UnionType):
        tests = [_test(each) for each in of]
        several = [test for test in tests if test is not None]
        return (lambda given: any(test(given) for test in several)) if len(several) == len(tests) else None
    if origin is Any or isinstance(origin, TypeVar):
        return None
    if origin.__name__ == "ndarray":
        return _is_array
    if origin in _TESTS:
        return _TESTS[origin]
    if not issubclass(origin, abc.Iterable) or not of:
        return lambda given: isinstance(given, origin)
    length = len(of) if origin is tuple and ... not in of else None
    return _elements(origin, [_test(each) for each in of if each is not ...], length)


def _elements(origin: Any, of: list[Test | None], length: int | None) -> Test:
    """Return the test of a collection, or a mapping, and of its elements; text is none, a row of numbers is."""
    def test(given: Any) -> bool:
        if hasattr(given, "ndim"):
            return of == [_is_finite] and given.ndim == 1 and all(map(_is_finite, given))
        if isinstance(given, (str, bytes)) or not isinstance(given, origin):
            return False
        if length is not None and len(given) != length:
            return False
        if isinstance(given, abc.Mapping):
            parts: list[abc.Iterable[Any]] = [given.keys(), given.values()]
        elif length is not None:
            parts = [(each,) for each in given]
        else:
            parts = [given if isinstance(given, abc.Collection) else ()]  # what can be gone through again
        return all(each is None or all(map(each, part)) for each, part in zip(of, parts))

    return test


def _is_array(given: Any) -> bool:
    import numpy as np  # names of models, which every command's help has, need none of it

    try:
        return np.asarray(given).dtype.kind in "biuf"
    except (TypeError, ValueError):  # rows of different lengths
        return False


def _is_finite(given: Any) -> bool:
    number: Any = given
    return isinstance(number, Real) and not isinstance(number, bool) and -_MOST <= number <= _MOST


def _is_text(given: Any) -> bool:
    if not isinstance(given, str) or "\0" in given:
        return False
    try:
        os.fsencode(given)  # names of files may have bytes that are no text
    except UnicodeEncodeError:  # half of a surrogate pair
        return False
    return True


_TESTS: dict[Any, Test] = {
    NoneType: lambda given: given is None,
    None: lambda given: given is None,
    bool: lambda given: type(given).__name__ == "bool",  # NumPy's has that name too
    int: lambda given: isinstance(given, Integral) and not isinstance(given, bool),
    float: _is_finite,
    str: _is_text,
    Path: lambda given: isinstance(given, Path) and _is_text(str(given)),
    abc.Callable: callable,
}


def _words(kind: Any) -> str:
    """Return what an annotation expects."""
    origin, of = get_origin(kind) or kind, get_args(kind)
    if origin in (Union, UnionType):
        return " or ".join(dict.fromkeys(_words(each) for each in of if not (each is str and Path in of)))
    name = getattr(origin, "__name__", str(origin))
    if name in _WORDS:
        return _WORDS[name]
    if issubclass(origin, abc.Iterable) and of:
        each = _words(of[-1] if of[-1] is not ... else of[0]).partition(" (")[0].removeprefix("a ")
        return f"a {name.lower()} of {each}" if each == "numbers" else f"a {name.lower()} of {each}s"
    return f"a {name}"
