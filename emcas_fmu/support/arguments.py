"""Checks of the arguments of the Python interface by their annotations: a wrong argument raises an EmcasError."""

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
Check = Callable[[Any], bool]

# Descriptions of annotations in messages; other classes are described by their names.
_WORDS = {"bool": "True or False", "int": "a whole number", "float": "a finite number", "str": "text", "Path": "a path",
          "NoneType": "None", "Callable": "a function", "ndarray": "numbers",
          "ParameterSet": "a parameter set (load_parameters() reads one from a file)",
          "Excitation": "one of emcas_fmu.excitations, such as excitations.reference_case('step_plus10')"}
_MOST: Any = sys.float_info.max  # an int may be larger
_brief = reprlib.Repr()
_brief.maxstring = _brief.maxother = 60


def checked(target: T) -> T:
    """Return a function, or a class with public methods, that first checks arguments by their annotations.

    A `float` must be finite. Text must be encodable and have no zero byte. An array must consist of numbers, finite or
    not. Each element of a collection is checked. A wrong argument raises ArgumentError with its name, its value and the
    expected type; a file that cannot be used raises EmcasError.
    """
    if isinstance(target, type):
        for name, member in list(vars(target).items()):
            if isinstance(member, FunctionType) and (not name.startswith("_") or name in ("__init__", "__getitem__")):
                setattr(target, name, checked(member))
        return target
    checks: _Checks | None = None

    @wraps(target)
    def call(*args: Any, **kwargs: Any) -> Any:
        nonlocal checks
        if checks is None:  # at the first call: annotations may name classes that are defined below the function
            checks = _Checks(target)
        for name, value in (*zip(checks.positional, args), *kwargs.items()):
            if not checks.accepts(name, value):
                raise checks.refusal(name, value)
        try:
            return target(*args, **kwargs)
        except OSError as error:
            if error.filename is None:  # raised by a callback of the caller, not for a file
                raise
            raise EmcasError(in_words(error)) from error

    return call  # type: ignore[return-value]


class _Checks:
    """Annotations of a function's arguments and their checks by name; `_rest` is the name of its ``**`` argument."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self._function = function.__qualname__.removesuffix(".__init__")
        parameters = inspect.signature(function).parameters.values()
        names = _Names(function.__globals__)
        self._annotations = {p.name: eval(p.annotation, {}, names) if isinstance(p.annotation, str) else Any
                             for p in parameters}
        self._checks = {name: _check(annotation) for name, annotation in self._annotations.items()}
        self._rest = next((p.name for p in parameters if p.kind == p.VAR_KEYWORD), "")
        self.positional = [p.name for p in parameters if p.kind in (p.POSITIONAL_ONLY, p.POSITIONAL_OR_KEYWORD)]

    def accepts(self, name: str, value: Any) -> bool:
        """Return whether an argument has the expected type; also true for an unknown argument, which Python refuses."""
        check = self._checks.get(name if name != self._rest and name in self._checks else self._rest)
        return check is None or check(value)

    def refusal(self, name: str, value: Any) -> ArgumentError:
        """Return the error for a wrong argument."""
        expected = self._annotations.get(name) or self._annotations[self._rest]
        return ArgumentError(f"{self._function}: {name} = {brief(value)}: expected {_words(expected)}")


def brief(value: Any) -> str:
    """Return a value as one line of a message, shortened."""
    return " ".join(_brief.repr(value).split())


class _Names(dict[str, Any]):
    """Names in annotations; a class that is imported for type checking only is replaced by :class:`_ByName`."""

    def __missing__(self, name: str) -> type:
        return getattr(builtins, name, None) or _ByName(name, (), {})


class _ByName(type):
    """A class that is not imported: an object is an instance if its class, or a base class, has this name."""

    def __instancecheck__(cls, value: Any) -> bool:
        return any(each.__name__ == cls.__name__ for each in type(value).__mro__)


def _check(kind: Any) -> Check | None:
    """Return the check of an annotation; None if any value is allowed."""
    origin, of = get_origin(kind) or kind, get_args(kind)
    if origin in (Union, UnionType):
        checks = [_check(each) for each in of]
        some = [check for check in checks if check is not None]
        return (lambda value: any(check(value) for check in some)) if len(some) == len(checks) else None
    if origin is Any or isinstance(origin, TypeVar):
        return None
    if origin.__name__ == "ndarray":
        return _is_array
    if origin in _CHECKS:
        return _CHECKS[origin]
    if not issubclass(origin, abc.Iterable) or not of:
        return lambda value: isinstance(value, origin)
    length = len(of) if origin is tuple and ... not in of else None
    return _elements(origin, [_check(each) for each in of if each is not ...], length)


def _elements(origin: Any, of: list[Check | None], length: int | None) -> Check:
    """Return the check of a collection and its elements; refuse text, and accept an array [n] for finite numbers."""
    def check(value: Any) -> bool:
        if hasattr(value, "ndim"):
            return of == [_is_finite] and value.ndim == 1 and all(map(_is_finite, value))
        if isinstance(value, (str, bytes)) or not isinstance(value, origin):
            return False
        if length is not None and len(value) != length:
            return False
        if isinstance(value, abc.Mapping):
            parts: list[abc.Iterable[Any]] = [value.keys(), value.values()]
        elif length is not None:
            parts = [(each,) for each in value]
        else:
            parts = [value if isinstance(value, abc.Collection) else ()]  # an iterator could not be read again
        return all(each is None or all(map(each, part)) for each, part in zip(of, parts))

    return check


def _is_array(value: Any) -> bool:
    import numpy as np  # late: every command's help lists names of models, for which NumPy is not needed

    try:
        return np.asarray(value).dtype.kind in "biuf"
    except (TypeError, ValueError):  # rows of different lengths
        return False


def _is_finite(value: Any) -> bool:
    number: Any = value
    return isinstance(number, Real) and not isinstance(number, bool) and -_MOST <= number <= _MOST


def _is_text(value: Any) -> bool:
    if not isinstance(value, str) or "\0" in value:
        return False
    try:
        os.fsencode(value)  # file names may have bytes that are not text
    except UnicodeEncodeError:  # half of a surrogate pair
        return False
    return True


_CHECKS: dict[Any, Check] = {
    NoneType: lambda value: value is None,
    bool: lambda value: type(value).__name__ == "bool",  # also the name of NumPy's type
    int: lambda value: isinstance(value, Integral) and not isinstance(value, bool),
    float: _is_finite,
    str: _is_text,
    Path: lambda value: isinstance(value, Path) and _is_text(str(value)),
    abc.Callable: callable,
}


def _words(kind: Any) -> str:
    """Return an annotation in words."""
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
