"""Checks of all values of an actuator together: names, limits, and rules for combinations."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from math import inf
from typing import Any

import numpy as np

from ..actuators import NONLINEAR, get
from ..actuators.declaration import Actuator
from ..actuators.external import refusal
from ..errors import hint
from ..ops.arrays import ARRAYS
from ..ops.floats import FLOATS
from ..rules import SHARES, Check, Rule, check_ranges, check_rules
from .entries import ParameterError


def check_parameters(values: Mapping[str, Any], model: str = NONLINEAR) -> list[str]:
    """Return messages about parameter `values`, by name in the variables' units; the list is empty if all are sound.

    Limits are checked if no name is missing or unknown, rules if all values are within their limits. Raises EmcasError
    for an unknown model, and if a rule in a user's file fails.
    """
    actuator = get(model)
    known = {v.name for v in actuator.file_entries}
    missing = [f"{v.name} is missing" for v in actuator.parameters if v.name not in values]
    unknown = [f"there is no parameter {name}{hint(name, known)}" for name in values if name not in known]
    if missing or unknown:
        return missing + unknown
    limits = [(v.name, v.minimum, v.maximum) for v in actuator.parameters if v.kind != "Boolean"]
    return check_ranges(values, limits) or check_combinations(values, actuator)


def require_sound(values: Mapping[str, Any], model: str = NONLINEAR) -> None:
    """Raise ParameterError with all messages of :func:`check_parameters`, if there are any."""
    if problems := check_parameters(values, model):
        raise ParameterError(problems)


def check_combinations(values: Mapping[str, Any], actuator: Actuator, warnings: bool = False) -> list[str]:
    """Return the messages of :func:`broken_rules`, with the same arguments and errors."""
    return list(broken_rules(values, actuator, warnings).values())


def broken_rules(values: Mapping[str, Any], actuator: Actuator, warnings: bool = False) -> dict[Rule, str]:
    """Return the broken rules of the actuator with their messages; `values` must be within their limits.

    With `warnings` these are the rules that only warn, otherwise those that refuse. Raises EmcasError if a rule in a
    user's file fails.
    """
    try:
        return messages(actuator.all_rules, actuator.namespace(values), warnings)
    except Exception as error:
        if actuator.source is None:
            raise
        raise refusal(error, actuator.source) from error


def messages(rules: Iterable[Rule], p: Any, warnings: bool) -> dict[Rule, str]:
    """Return those of `rules` that the nested parameters `p` break, with their messages; see :func:`broken_rules`."""
    return {rule: message for rule in rules if rule.warning == warnings
            for message in check_rules([_bound(rule, p)], warnings)}


def _bound(rule: Rule, p: Any) -> Check:
    """Return a rule bound to parameters; a scanned rule is evaluated at the share of the travel that breaks it most."""
    each = partial(rule.check, FLOATS, p), *rule[1:]
    if not rule.scanned:
        return each
    shares = np.array(SHARES)
    try:
        with np.errstate(all="ignore"):  # shares where the result is not a number are left out
            broken = np.broadcast_to(rule.check(ARRAYS, p, shares)[0], shares.shape)
    except Exception:  # a user's rule that fails with arrays: it is scanned with numbers  # noqa: BLE001
        return each
    worst = SHARES[int(np.argmax(np.where(np.isnan(broken), -inf, broken)))]
    return lambda _: rule.check(FLOATS, p, worst), rule.message, False, rule.warning
