"""Checks of an actuator's values as a whole: names, limits, and the rules that combinations must keep."""

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
    """Return the problems of an actuator's values by name: missing or unknown names, limits, combinations."""
    actuator = get(model)
    known = {v.name for v in actuator.file_entries}
    missing = [f"{v.name} is missing" for v in actuator.parameters if v.name not in values]
    unknown = [f"there is no parameter {name}{hint(name, known)}" for name in values if name not in known]
    if missing or unknown:
        return missing + unknown
    limits = [(v.name, v.minimum, v.maximum) for v in actuator.parameters if v.kind != "Boolean"]
    return check_ranges(values, limits) or check_combinations(values, actuator)


def require_sound(values: Mapping[str, Any], model: str = NONLINEAR) -> None:
    """Raise ParameterError with the problems of an actuator's values by name, if there are any."""
    if problems := check_parameters(values, model):
        raise ParameterError(problems)


def check_combinations(values: Mapping[str, Any], actuator: Actuator, warnings: bool = False) -> list[str]:
    """Return a message for each rule of the actuator that values, which are within their limits, break.

    These are the rules that refuse, or those that only warn (`warnings`).
    """
    return list(broken_rules(values, actuator, warnings).values())


def broken_rules(values: Mapping[str, Any], actuator: Actuator, warnings: bool = False) -> dict[Rule, str]:
    """Return the broken rules with their messages; see `check_combinations`."""
    try:
        return messages(actuator.all_rules, actuator.namespace(values), warnings)
    except Exception as error:
        if actuator.source is None:
            raise
        raise refusal(error, actuator.source) from error


def messages(rules: Iterable[Rule], p: Any, warnings: bool) -> dict[Rule, str]:
    """Return the broken ones of `rules` with their messages, for nested parameters `p`; see `check_combinations`."""
    return {rule: message for rule in rules if rule.warning == warnings
            for message in check_rules([_bound(rule, p)], warnings)}


def _bound(rule: Rule, p: Any) -> Check:
    """Return a rule bound to parameters; a scanned rule is evaluated for all shares of the travel at once."""
    each = partial(rule.check, FLOATS, p), *rule[1:]
    if not rule.scanned:
        return each
    shares = np.array(SHARES)
    try:
        with np.errstate(all="ignore"):  # shares where the result is not a number are left out
            broken = np.broadcast_to(rule.check(ARRAYS, p, shares)[0], shares.shape)
    except Exception:  # a user's rule that cannot be traced; tracing reports that  # noqa: BLE001
        return each
    worst = SHARES[int(np.argmax(np.where(np.isnan(broken), -inf, broken)))]
    return lambda _: rule.check(FLOATS, p, worst), rule.message, False, rule.warning
