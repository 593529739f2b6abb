"""Equations of one actuator with other parameters: how a simpler one is put together from a richer one."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from ...ops.base import Ops, Value


def rewired(function: Callable[..., Any], change: Callable[[Ops, Any], Any]) -> Callable[..., Any]:
    """Return `function` of an actuator, called with the parameters that `change` makes of those it is given."""
    @wraps(function)
    def with_changes(ops: Ops, p: Any, *arguments: Value) -> Any:
        return function(ops, change(ops, p), *arguments)

    return with_changes
