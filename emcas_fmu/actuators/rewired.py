"""Functions of one model with other parameters: how a simpler model is wired from another's."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any

from ..ops.base import Ops, Value


def rewired(function: Callable[..., tuple[Value, ...]], change: Callable[[Ops, Any], Any]
            ) -> Callable[..., tuple[Value, ...]]:
    """`function` of an actuator, name and arguments kept, given the parameters that `change` makes of its own."""
    @wraps(function)
    def with_changes(ops: Ops, p: Any, *arguments: Value) -> tuple[Value, ...]:
        return function(ops, change(ops, p), *arguments)

    return with_changes
