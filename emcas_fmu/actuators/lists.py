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
    """Raise EmcasError if a list of a declaration is a single entry, or has a list as an entry.

    Such a list lacks a comma, or a * before a tuple such as FIN or an array of parameters. Entries may be named tuples.
    """
    for field in fields(actuator):
        annotation, entries = str(field.type), getattr(actuator, field.name)
        if not annotation.endswith(", ...]"):
            continue
        if type(entries) not in (tuple, list):
            raise EmcasError(f"actuator {actuator.name}: {field.name} is not a list; write a comma after a single "
                             f"entry, {field.name}=(...,)")
        if "tuple[tuple" not in annotation and any(type(each) is tuple for each in entries):
            raise EmcasError(f"actuator {actuator.name}: an entry of {field.name} is a list; write * before it, as in "
                             "*em.FIN and *em.array(...)")


def check_functions(actuator: Any) -> None:
    """Raise EmcasError for a function of a declaration with other arguments than those with which it is called."""
    for name, arguments in _ARGUMENTS.items():
        if (function := getattr(actuator, name)) is not None:
            check_arguments(f"actuator {actuator.name}", function, arguments)
    for rule in (*actuator.rules, *actuator.supply_rules):
        check_arguments(f"actuator {actuator.name}, rule {rule.message!r}", rule.check, "ops, p, share")
    if len(signature(actuator.initial).parameters) != 4:
        check_arguments(f"actuator {actuator.name}", actuator.initial, "ops, p, start")


def check_arguments(owner: str, function: Callable[..., Any], arguments: str) -> None:
    """Raise EmcasError if a function cannot be called with `arguments`, their names separated by ", "."""
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
        if missing := [name for name in without if name not in names]:
            raise EmcasError(f"actuator {actuator.name}: imperfections[{imperfection!r}]: there is no parameter "
                             f"{missing[0]}{hint(missing[0], names)}; declare it, or leave it out")
