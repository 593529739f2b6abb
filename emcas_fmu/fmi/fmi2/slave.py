"""The co-simulation slave: it passes FMI calls to the core of one fin, or to the cores of several.

It is embedded in the FMU and imports only the standard library, pythonfmu's base class and other embedded modules.
reporting.py describes the errors that it refuses and logs; declared.py has the declarations of the generated class.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partialmethod
from math import inf, isfinite, nan
from typing import Any

from ...rules import NO_VARIABLE, TOO_LATE, UNCONNECTED
from ...runtime.core import Core, finite
from ...runtime.multi_fin import MultiFin
from . import stored
from .declared import DeclaredSlave
from .reporting import RefusedError
from .stored import StoredState, is_text, wrong_variable

_BEFORE_RUN = ("instantiated", "initialization")


class Slave(DeclaredSlave):
    """Base of the generated slave class: steps, variables and states."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._core: Core | MultiFin | None = None
        self._bound: tuple[Any, ...] = ()  # parameter values of the core
        self._start, self._stop = 0.0, inf  # s
        self._now = 0.0  # s since the start
        self._refusal = ""  # reason why the initialization was refused
        self._commanded = False  # _check_drive has seen a command other than 0
        self._changed = True  # parameters have changed since the core was bound to them
        self._fresh = False  # outputs in _values are up to date
        self._motion: list[float] = []  # the vehicle's, for which _motion_loads were computed
        self._cached_inputs: tuple[Any, ...] | None = None  # of the core, until a variable is set
        self._slack = 0.0  # s: tolerance of a step's start
        self._latest = inf  # s: latest end of a step
        self._motion_loads: Any = None

    def setup_experiment(self, start_time: float, stop_time: float | None = None,
                         tolerance: float | None = None) -> None:
        if self._allowed("instantiated", "fmi2SetupExperiment"):
            self._start, self._stop = start_time, inf if stop_time is None else stop_time

    def enter_initialization_mode(self) -> None:
        if self._allowed("instantiated", "fmi2EnterInitializationMode"):
            self._phase = "initialization"

    def exit_initialization_mode(self) -> None:
        self._guard(self._initialize)

    def terminate(self) -> None:
        self._phase = "terminated"
        self._ready = False

    def _initialize(self) -> None:
        if not self._allowed("initialization", "fmi2ExitInitializationMode"):
            return
        self._phase = "running"
        problems = self._parameter_problems()
        if not isfinite(self._start):
            problems.append(f"start time {self._start!r} is not finite")
        elif not self._stop >= self._start:
            problems.append(f"stop time {self._stop!r} s is not at or after the start time {self._start!r} s")
        elif not problems:
            problems += filter(None, [_too_late(self._start, self._bind(anew=True))])
        if problems:
            self._refusal = "; ".join(problems)
            for problem in problems:
                self._log(f"initialization refused: {problem}")
            self._say(f"initialization refused: {self._refusal}")
            return
        self._clear_outputs()
        self._refresh()  # in the run it would not clear the outputs if an input is not finite
        self._warn()

    def do_step(self, current_time: float, step_size: float) -> bool:
        state, now = None, self._now
        try:
            begin = current_time - self._start
            # The usual step; comparisons with NaN are false.
            if self._ready and abs(begin - self._now) <= self._slack and 0.0 < step_size < inf:
                core: Any = self._core
                end = begin + step_size
                if current_time + step_size > self._latest:
                    raise RefusedError(f"step of {step_size!r} s from {current_time!r} s ends after the stop time, "
                                       f"{self._stop!r} s")
                if end < now:  # a host's time may go back within the tolerance, the trajectory does not
                    end = now
                if self.step_begin is not None:
                    self._values[self.step_begin], self._cached_inputs = begin, None
                inputs = self._cached_inputs or self._checked_inputs(core, current_time)
                state = core.state
                self._values[self._output_slice] = core.run(end, inputs)
                self._now = end
                self._fresh = True
                return True
            return self._step(current_time, step_size)
        except RefusedError as error:
            reason = str(error)
        except BaseException as error:  # noqa: BLE001  KeyboardInterrupt too: see reporting.py
            if state is not None:
                core.state, self._now, self._fresh = state, now, False
            reason = f"step of {step_size!r} s from {current_time!r} s: {type(error).__name__}: {error}"
        self._log(reason, "discard")
        return False

    def _step(self, current_time: float, step_size: float) -> bool:
        """Check everything that a step needs, and compute it."""
        if self._phase != "running":
            raise RefusedError(f"fmi2DoStep called while {self._phase}")
        if self._refusal:
            raise RefusedError(f"initialization was refused: {self._refusal}")
        if self._misuse:
            misuse, self._misuse = self._misuse, ""
            self._ready = not self._changed
            raise RefusedError(misuse)
        if self._changed or self._core is None:
            problems = self._parameter_problems()
            if problems:
                raise RefusedError("; ".join(problems))
            self._bind(anew=False)
            self._warn()
        self._ready = True
        begin = current_time - self._start
        if not 0.0 < step_size < inf:
            raise RefusedError(f"communication step {step_size!r} s at {current_time!r} s is not positive and finite")
        if not abs(begin - self._now) <= self._slack:
            raise RefusedError(f"step from {current_time!r} s, but the instance is at {self._start + self._now!r} s")
        return self.do_step(current_time, step_size)

    def _checked_inputs(self, core: Any, current_time: float) -> tuple[Any, ...]:
        inputs = self._core_inputs(core)
        if self._finite(inputs):
            self._cached_inputs = inputs
            if not self._commanded:
                self._check_drive(inputs if self._several else (inputs,))
            return inputs
        bad = [f"{self.rows[i][0]} = {self._values[i]!r}" for i in self.inputs if not isfinite(self._values[i])]
        raise RefusedError(f"input at {current_time!r} s is not finite: {', '.join(bad)}")

    def _check_drive(self, inputs: tuple[Any, ...]) -> None:
        """At the first command other than 0, warn if supply or enable is 0: the input may be unconnected."""
        fin = next((fin for fin in inputs if fin[0] != 0.0), None)
        if fin is None:
            return
        self._commanded = True
        supply, enable = fin[1 + self.sizes.loads:3 + self.sizes.loads]
        if self.no_supply and supply == 0.0:
            self._log(UNCONNECTED % self.no_supply, "warning")
        if not enable:
            self._log(UNCONNECTED % "enable = 0", "warning")

    def _core_inputs(self, core: Any) -> tuple[Any, ...]:
        motion = self._values[self.motion]
        if motion != self._motion:
            # The caller refuses a motion that is not finite; its trigonometry would raise.
            self._motion_loads = core.motion_loads(*motion) if isfinite(sum(motion)) else self._nan_loads
            self._motion = motion
        values = self._values
        if not self._several:
            return self._inputs_of_one(values[:self.outputs.start], self._motion_loads)
        rows = [[values[i] for i in indices] for indices in self.fin_inputs]
        acting: tuple[Any, ...] = core.acting(rows, self._motion_loads, [values[i] for i in self.mixing])
        return acting

    def _bind(self, anew: bool) -> Any:
        """Return the core, bound to the parameters: a new one if `anew`, as until the end of initialization."""
        values = self._parameter_values()
        if self._core is None or anew:
            self._core = self._new_core(values)
        else:
            self._core.bind(self._functions(values))
        self._bound = tuple(values.values())
        self._changed = False
        self._forget()
        return self._core

    def _forget(self) -> None:
        """Discard values computed from core and inputs, one of which has changed, and renew the tolerances."""
        self._motion, self._cached_inputs, self._fresh = [], None, False
        if self._core is not None:
            # Far from 0, the rounding of a host's times may exceed the core's slack.
            self._slack = self._core.slack + 1e-15 * abs(self._start)
            # A host that sums its steps may miss the stop time, by up to 1e-9 of it.
            self._latest = self._stop + self._core.slack + 1e-9 * abs(self._stop)

    def _get(self, kind: str, missing: Any, vrs: Sequence[int]) -> list[Any]:
        try:
            if not self._fresh:
                self._refresh()
            values = self._values
            references = self._kinds[kind]
            if references.issuperset(vrs):
                return list(map(values.__getitem__, vrs))
            for vr in vrs:
                if vr not in references:
                    self._log(NO_VARIABLE % (kind, vr))
            return [values[vr] if vr in references else missing for vr in vrs]
        except BaseException as error:  # noqa: BLE001  see reporting.py
            self._misused(f"reading variables: {type(error).__name__}: {error}")
            return [missing] * len(vrs)

    def _refresh(self) -> None:
        """Update the outputs in `_values`.

        They cannot be computed if an input is not finite or parameters break a limit or rule, for which the next step
        is refused: in the run they are then unchanged; before it, or after a refused initialization, NaN, 0 or false.
        """
        core = self._core
        if self._phase in _BEFORE_RUN:
            core = None if self._parameter_problems() else self._bind(anew=True)
        elif core is not None and self._changed and not self._refusal:
            if self._parameter_problems():
                return
            core = self._bind(anew=False)
            self._changed = True  # the next step logs warnings
        if core is None or self._refusal:
            self._clear_outputs()
        elif self._finite(inputs := self._cached_inputs or self._core_inputs(core)):
            self._values[self._output_slice] = core.outputs(inputs)
        elif self._phase in _BEFORE_RUN:
            self._clear_outputs()
        self._fresh = True

    def _clear_outputs(self) -> None:
        self._values[self._output_slice] = [nan if self.rows[i][1] == "Real" else 0 for i in self.outputs]

    def _set(self, kind: str, vrs: Sequence[int], values: Sequence[Any]) -> None:
        try:
            self._cached_inputs = None
            self._fresh = False
            references = self._kinds[kind]
            for vr, value in zip(vrs, values, strict=False):
                if vr in self.inputs and vr in references and vr not in self.held:
                    self._values[vr] = value
                else:
                    self._set_other(kind, vr, value)
        except BaseException as error:  # noqa: BLE001  see reporting.py
            self._misused(f"setting variables: {type(error).__name__}: {error}")

    def _set_other(self, kind: str, vr: int, value: Any) -> None:
        if vr not in self._kinds[kind]:
            message = NO_VARIABLE % (kind, vr)
            self._log(message)
            self._say(f"{message}; it is not set")
        elif vr in self.outputs:
            self._misused(f"{self.rows[vr][0]} is an output and cannot be set")
        elif self._phase in ("running", "terminated") and self.rows[vr][2]:
            self._misused(f"{self.rows[vr][0]} is fixed and cannot be set after initialization")
        else:
            self._values[vr] = value
            self._changed = True
            self._ready = False

    get_real = partialmethod(_get, "Real", nan)
    get_boolean = partialmethod(_get, "Boolean", False)
    get_string = partialmethod(_get, "String", "")
    set_real = partialmethod(_set, "Real")
    set_integer = partialmethod(_set, "Integer")
    set_boolean = partialmethod(_set, "Boolean")
    set_string = partialmethod(_set, "String")

    def get_integer(self, vrs: Sequence[int]) -> list[int]:
        return list(map(int, self._get("Integer", 0, vrs)))

    def _get_fmu_state(self) -> Any:
        """Return the state, without misuse: the step that is refused for it is not refused again after a rollback."""
        core = None if self._core is None else self._core.state
        return (self._start, self._now, self._phase, self._refusal, self._changed, tuple(self._values), self._bound,
                core, self._stop)

    def _set_fmu_state(self, state: Any) -> None:
        if isinstance(state, str):  # the reason why the bytes contain no state
            self._misused(f"FMU state refused: {state}")
        else:
            self._guard(lambda: self._restore(self._checked(state) if isinstance(state, StoredState) else state))

    def _restore(self, state: Any) -> None:
        start, now, phase, refusal, changed, values, bound, core_state, stop = state
        core = self._core
        if core_state is None:
            core = None
        elif core is None or bound != self._bound:
            parameters = {self.rows[i][0]: v for i, v in zip(self.parameters, bound, strict=True)}
            core = self._new_core(parameters)
        self._start, self._stop, self._now, self._phase = start, stop, now, phase
        self._refusal, self._changed, self._values = refusal, changed, list(values)
        self._bound, self._core = bound, core
        if core is not None:
            core.state = core_state
        self._ready = False
        self._forget()

    def _checked(self, state: StoredState) -> Any:
        """Return a stored state, or raise RefusedError if it cannot be one of this FMU, as `unsound` in states.h."""
        if len(state) != len(self._get_fmu_state()):
            raise RefusedError("FMU state refused: wrong number of values")
        start, now, phase, refusal, changed, values, bound, core_state, stop = state
        parameters = [self.rows[i] for i in self.parameters]
        if phase not in (*_BEFORE_RUN, "running", "terminated"):
            problem = "unknown phase"
        elif not (finite(start) and finite(now) and now >= 0.0 and isinstance(stop, float | int) and stop >= start):
            problem = "impossible time"
        elif not (is_text(refusal) and isinstance(changed, bool)):
            problem = "impossible text of a refusal"
        elif wrong := wrong_variable(values, self.rows):
            problem = wrong
        elif phase in _BEFORE_RUN:  # the end of initialization makes a new core
            return start, 0.0, phase, refusal, True, values, (), None, stop
        elif core_state is None:
            problem = "" if bound == () and (refusal or phase == "terminated") else "its core is missing"
        elif wrong := wrong_variable(bound, parameters):
            problem = wrong
        elif not changed and values[self.parameters.start:] != bound:
            problem = "its parameters differ"
        else:
            by_name = {row[0]: value for row, value in zip(parameters, bound, strict=True)}
            problem = "; ".join(self._parameter_problems(by_name))
            if not problem:
                core = self._new_core(by_name)
                shape = self._inputs_of_one((0.0,) * len(self.fin_inputs[0]), (0.0,) * (self.sizes.loads - 1))
                problem = _too_late(start, core) or core.unsound(core_state, now, shape)
        if problem:
            raise RefusedError(f"FMU state refused: {problem}")
        return state

    @classmethod
    def _fmu_state_to_bytes(cls, state: Any) -> bytes:
        return stored.to_bytes(cls.fmu_guid, None if isinstance(state, str) else state)

    @classmethod
    def _fmu_state_from_bytes(cls, data: bytes) -> Any:
        return stored.from_bytes(cls.fmu_guid, data)


def _too_late(start: float, core: Any) -> str:
    """Return the message for a start time [s] at which doubles are too coarse for a core's ticks; otherwise ""."""
    return "" if abs(start) <= core.latest else TOO_LATE % (start, core.latest)
