"""Checks of a declaration: its lists, the arguments of its functions, and its imperfections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from inspect import signature, unwrap
from typing import Any

from ..errors import EmcasError, hint

_ARGUMENTS = {"sample": "ops, p, x, inputs", "derivatives": "ops, p, x, u", "step": "ops, p, x, u, h",
              "output_values": "ops, p, x, u", "as_built": "ops, p", "longest_tick": "ops, p",
              "transport_delay": "ops, p", "feed_forward": "ops, p, motion, memory"}


def check_lists(actuator: Any) -> None:
    """Raise EmcasError for a field of a declaration that is an entry instead of a list, or has a list as an entry.

    A comma or a * was forgotten: FIN and an array of parameters are tuples. Entries may be named tuples.
    """
    for field in fields(actuator):
        annotation, entries = str(field.type), getattr(actuator, field.name)
        if annotation.endswith(", ...]") and type(entries) not in (tuple, list):
            raise EmcasError(f"actuator {actuator.name}: {field.name} is not a list; write a comma after a single "
                             f"entry, {field.name}=(...,)")
        nested = "tuple[tuple" in annotation
        if annotation.endswith(", ...]") and not nested and any(type(each) is tuple for each in entries):
            raise EmcasError(f"actuator {actuator.name}: an entry of {field.name} is a list; write * before it, as in "
                             "*em.FIN and *em.array(...)")


def check_functions(actuator: Any) -> None:
    """Raise EmcasError for a function of a declaration that cannot be called with the arguments that it will get."""
    for name, arguments in _ARGUMENTS.items():
        if (function := getattr(actuator, name)) is not None:
            check_arguments(f"actuator {actuator.name}", function, arguments)
    for rule in (*actuator.rules, *actuator.supply_rules):
        check_arguments(f"actuator {actuator.name}, rule {rule.message!r}", rule.check, "ops, p, share")
    if len(signature(actuator.initial).parameters) != 4:
        check_arguments(f"actuator {actuator.name}", actuator.initial, "ops, p, start")


def check_arguments(owner: str, function: Callable[..., Any], arguments: str) -> None:
    """Raise EmcasError for a function that cannot be called with `arguments`, names that are separated by commas."""
    try:
        signature(function).bind(*arguments.split(", "))
    except TypeError:
        code = getattr(unwrap(function), "__code__", None)
        named = f"{code.co_name}() in line {code.co_firstlineno}" if code else repr(function)
        raise EmcasError(f"{owner}: {named} has the arguments {signature(function)}; it is called with ({arguments})"
                         ) from None


def check_imperfections(actuator: Any) -> None:
    """Raise EmcasError for an imperfection whose parameter the declaration does not have."""
    names = {v.name for v in actuator.parameters}
    for imperfection, without in actuator.imperfections.items():
        for name in without:
            if name not in names:
                raise EmcasError(f"actuator {actuator.name}: imperfections[{imperfection!r}]: there is no parameter "
                                 f"{name}{hint(name, names)}; declare it, or leave it out")
