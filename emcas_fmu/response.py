"""A simulated response of one or several fins, with its figures, tables and plots."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from functools import cached_property
from html import escape
from math import degrees, inf, isfinite, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup

from .actuators import extension_outputs, fin_port, get
from .bench import metrics
from .bench.conditions import ESTIMATE, conditions, resting_on
from .bench.excitation import COMMAND, Excitation
from .bench.runs import Columns, Run
from .errors import EmcasError, hint
from .fmi.interface import MIXING, FmuInterface
from .ops.floats import FLOATS
from .pages.numbers import number
from .pages.page import code, stated, write_page
from .parameters import ParameterSet
from .simulation import Array
from .support import extras
from .support.arguments import checked
from .units import UnitError, convert
from .variables import Variable

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

# A message with C's formats for command [rad], command [deg] and limit [deg]; the page of emcas explore also uses it.
CLIPPED = f"{COMMAND} reaches %.4g rad (%.4g deg); beyond command.limit = %.4g deg it is clipped"
ROUNDING = 1e-9  # relative; a command at its limit may exceed it by rounding
IN_DEGREES = ". Commands are in rad: is it in degrees?"
LIKE_DEGREES = pi * (1.0 + ROUNDING)  # rad; a larger command is probably in degrees. Also the limit of --step
_MOST_CHANGES = 4  # largest number of changes of a status that are listed
_MOST_PANELS = 8  # largest number of panels for an actuator's outputs beyond the fin port's


@checked
@dataclass(frozen=True)
class Response:
    """The outputs of one or several fins under an excitation.

    `unit` describes the interface, `sets` are the fins' parameters. `columns` has ``time`` [s] and the outputs [SI] by
    name, arrays [rows].
    """

    unit: FmuInterface
    sets: Sequence[ParameterSet]
    excitation: Excitation
    columns: Columns

    @property
    def time(self) -> Array:
        """Times of the rows [s]."""
        return self.columns["time"]

    @cached_property
    def _all_columns(self) -> Columns:
        return {**self.excitation.columns, **self.columns}

    def __getitem__(self, name: str) -> Array:
        """Return an output, an input of the excitation, or ``time``: an array [rows] in the unit of `units`.

        Raises EmcasError for an unknown name.
        """
        if name not in self._all_columns:
            raise EmcasError(f"there is no {name}{hint(name, self._all_columns)}; "
                             f"there is {', '.join(self._all_columns)}")
        return self._all_columns[name]

    @cached_property
    def units(self) -> Mapping[str, str]:
        """Units of outputs, inputs and time by name; empty for Booleans and counts."""
        unit_of = {v.name: v.unit for v in (*self.unit.inputs, *self.unit.outputs)}
        return {"time": "s", **{name: unit_of[name] for name in self._all_columns if name != "time"}}

    def in_unit(self, name: str, unit: str) -> Array:
        """Return a column in another unit, as ``response.in_unit("fin_angle", "deg")``: an array [rows].

        Raises EmcasError for an unknown name, and for a unit of another quantity.
        """
        column, measured_in = self[name], self.units[name]
        try:
            zero, one = (convert(Decimal(amount), measured_in, unit) for amount in (0, 1))
        except UnitError as error:
            raise EmcasError(f"{name}: the unit {unit} does not measure it; "
                             f"{f'it is in {measured_in}' if measured_in else 'it has none'}") from error
        return zero + (one - zero) * column

    @cached_property
    def fins(self) -> tuple[Run, ...]:
        """The run of each fin, with a single actuator's variable names and the mixed command; it is judged from 0 s."""
        return tuple(self._run(fin) for fin in range(self.unit.fins))

    def _run(self, fin: int) -> Run:
        def of_fin(variables: Sequence[Variable], columns: Columns) -> dict[str, Any]:
            names = {v.name: self.unit.name(v.name, fin) for v in variables}
            return {name: columns[full] for name, full in names.items() if full in columns}

        inputs = of_fin(self.unit.actuator.inputs, self.excitation.columns)
        if any(v.name in self.excitation.columns for v in MIXING):
            inputs[COMMAND] = fin_port.mixed_command(
                FLOATS, self.sets[fin].nested(), inputs.get(COMMAND, np.zeros(len(self.time))),
                *(self.excitation.columns.get(v.name, 0.0) for v in MIXING))
        return Run(replace(self.excitation, columns=inputs, begin=0.0),
                   {"time": self.time, **of_fin(self.unit.actuator.outputs, self.columns)}, None, (), 0.0)

    @cached_property
    def line(self) -> Mapping[str, float]:
        """The figures of the supply line that several fins share; their names end in units. Empty without a line."""
        if self.unit.line is None:
            return {}
        level, current = self.unit.line.outputs
        (lowest, by), (peak, times) = (metrics.named(f"{figure}_{v.name}", v.unit)
                                       for figure, v in (("lowest", level), ("peak", current)))
        power = Run(self.excitation, {name: self.columns[name] for name in ("time", "supply_power")}, None, (), 0.0)
        return {lowest: by * float(np.min(self.columns[level.name])),
                peak: times * float(np.max(np.abs(self.columns[current.name]))),
                **metrics.displayed(metrics.usage_figures(power))}

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Messages about commands beyond their limit, one line each."""
        messages: dict[str, None] = {}
        for run, parameters in zip(self.fins, self.sets, strict=True):
            limit = parameters.values.get("command.limit", inf)
            most = float(np.max(np.abs(run.excitation.command)))
            if most > limit * (1.0 + ROUNDING):
                clipped = CLIPPED % (most, degrees(most), degrees(limit))
                messages[clipped + (IN_DEGREES if most > LIKE_DEGREES else "")] = None
        return tuple(messages)

    @property
    def extension_outputs(self) -> tuple[Variable, ...]:
        """Outputs that the model's extensions add."""
        return extension_outputs(self.unit.kind)

    def metrics(self, fin: int = 0) -> dict[str, float]:
        """Return the figures and final values of a fin by name; `fin` counts from 0.

        The names of figures end in units; the final value of an extension's output is in the unit of the output.
        Figures of a motion, such as ``rise_time_s`` and ``overshoot_percent``, are included if the command jumps once.
        Figures of outputs that the actuator lacks are left out. Raises EmcasError for an unknown fin.
        """
        if not 0 <= fin < self.unit.fins:
            raise EmcasError(f"there is no fin {fin}: they are counted from 0 to {self.unit.fins - 1} here")
        return dict(self._figures[fin])

    @cached_property
    def _figures(self) -> tuple[Mapping[str, float], ...]:
        return tuple(map(self._figures_of, self.fins))

    def _figures_of(self, run: Run) -> dict[str, float]:
        motion = metrics.motion_figures(run) if len(run.excitation.moves) == 1 else {}
        return {**{f"{name}_final_deg": degrees(run.columns[name][-1]) for name in ("fin_angle", "tracking_error")},
                **metrics.displayed({**metrics.usage_figures(run), **motion}),
                **{f"{v.name}_final": float(run.columns[v.name][-1]) for v in self.extension_outputs}}

    @cached_property
    def estimates(self) -> Mapping[str, tuple[str, ...]]:
        """The parameters that are engineering estimates, by the name of the final value that depends on them."""
        outputs: dict[str, dict[str, None]] = {}
        for each in self.sets:
            for name, parameters in each.estimated_outputs.items():
                outputs.setdefault(f"{name}_final", {}).update(dict.fromkeys(parameters))
        return {name: tuple(parameters) for name, parameters in outputs.items()}

    def as_dict(self) -> dict[str, Any]:
        """Return title, figures and estimates for JSON; for several fins also the figures of their line."""
        figures: dict[str, Any] = {**self.metrics()}
        if self.unit.fins > 1:
            line = {self.unit.line.group: dict(self.line)} if self.unit.line else {}
            figures = {**line, "fins": [dict(each) for each in self._figures]}
        estimates = {name: list(parameters) for name, parameters in self.estimates.items()}
        return {"title": self.excitation.title, **figures, **({"estimates": estimates} if estimates else {})}

    def lines(self) -> list[tuple[str, ...]]:
        """Return a row for each figure and each status: its name (marked if an estimate), then a text for each fin."""
        return [(self._marked(name), *values) for name, *values in self._lines()]

    def _marked(self, name: str, words: str = "") -> str:
        return (words or name) + ESTIMATE * (name in self.estimates)

    def _lines(self) -> list[tuple[str, ...]]:
        discrete = {f"{v.name}_final": v for v in self.extension_outputs if v.items or v.bits}
        rows = [(name, *(self._text(name, each[name]) for each in self._figures))
                for name in self._figures[0] if name not in discrete]
        return rows + [(v.name, *(_history(v, self.time, run.columns[v.name]) for run in self.fins))
                       for v in discrete.values()]

    def _text(self, name: str, value: float) -> str:
        """Return a figure as text: its value, "not within" the time that was simulated for it, or "not reached"."""
        moves = self.fins[0].excitation.moves
        if isfinite(value) or not moves:
            return number(value)
        waited = moves[0].end - moves[0].start
        if name in ("settling_time_s", "time_to_accuracy_s"):
            waited *= 1.0 - metrics.HELD  # the angle must stay within the band for the rest
        return f"not within {number(waited)} s" if metrics.unit_of(name) == "s" else "not reached"

    def write_csv(self, path: Path | str) -> None:
        """Write time, the inputs of the excitation and every output to a CSV file, SI, with all digits of a float.

        Raises EmcasError for a file that cannot be written.
        """
        from .bench.writers import write_csv  # with JUnit's library

        write_csv({"time": self.time, **self._all_columns}, path)

    def to_dataframe(self) -> pandas.DataFrame:
        """Return all columns as a pandas DataFrame with index time [s]; its ``attrs["units"]`` has their units.

        Raises EmcasError without pandas.
        """
        extras.require("", "to_dataframe() needs", "pandas")
        import pandas

        frame = pandas.DataFrame({name: column for name, column in self._all_columns.items() if name != "time"},
                                 index=pandas.Index(self.time, name="time"))
        frame.attrs["units"] = dict(self.units)
        return frame

    def plot(self, path: Path | str | None = None) -> Figure:
        """Plot command, outputs and limits over time; write the plot to `path`, if passed.

        `path` ends in ``.html`` (a page with figures), ``.svg``, ``.png`` or ``.pdf``. Returns the Matplotlib figure,
        which a notebook shows. Raises EmcasError for another ending, or a file that cannot be written.
        """
        from .plotting.plots import style, write  # with Matplotlib, a third of the start of every command
        from .response_plot import draw

        with style():
            estimated = {name.removesuffix("_final") for name in self.estimates}
            plotted = draw(self.unit, self.excitation.title, self.fins, self.columns, panel_outputs(self.unit.kind),
                           estimated)
            if path is not None and Path(path).suffix == ".html":
                self._write_page(plotted, Path(path))
            elif path is not None:
                write(plotted, Path(path))
        return plotted

    def _write_page(self, plotted: Figure, path: Path) -> None:
        """Write a page with the figures and the plot; call it inside `style()`."""
        from .plotting.plots import picture

        shown = picture(plotted, self.excitation.title, "Command, outputs and limits over time; shaded where a limit "
                                                      f"{'of any fin ' * (self.unit.fins > 1)}is active.")
        fins = [">value"] if self.unit.fins == 1 else [f">fin {fin + 1}" for fin in range(self.unit.fins)]
        write_page(path, "response.html.j2", list(dict.fromkeys(self.sets)), r=self, picture=shown, rows=self._rows(),
                   line=[(metrics.in_words(name), metrics.unit_of(name), value) for name, value in self.line.items()],
                   estimates=resting_on({metrics.in_words(name): rests for name, rests in self.estimates.items()}),
                   conditions=list(self._conditions()), fins=fins)

    def _rows(self) -> list[tuple[str, str, list[str]]]:
        """Return for each figure its name in words, its unit and a text for each fin; times are in ms."""
        units = {f"{v.name}_final": v.unit for v in self.extension_outputs}
        rows = []
        for name, *values in self._lines():
            unit = units.get(name, metrics.unit_of(name))
            if unit == "s":
                unit = "ms"
                values = [number(1e3 * each[name]) if isfinite(each[name]) else text
                          for each, text in zip(self._figures, values, strict=True)]
            rows.append((self._marked(name, metrics.in_words(name)), unit, values))
        return rows

    def _conditions(self) -> Iterator[tuple[str, str]]:
        """Yield label and value of times, inputs, conditions, and parameters set outside files or different by fin."""
        excitation = self.excitation
        yield "time", f"{number(excitation.stop)} s in communication steps of {number(1e3 * excitation.step)} ms"
        for name, column in excitation.columns.items():
            unit, scale = metrics.shown(self.units[name])
            ends = dict.fromkeys(stated(scale * float(end), unit) for end in (np.min(column), np.max(column)))
            yield code(name), Markup(" … ").join(ends)
        usual = conditions(self.unit.kind, self.sets[0].values)
        yield from ((label, stated(value, unit, name)) for label, name, value, unit in usual
                    if name not in excitation.columns)
        for entries in zip(*(each.entries for each in self.sets), strict=True):
            v, same = entries[0].variable, len({e.value for e in entries}) == 1
            if not same or any(e.source == "user" and not e.file for e in entries):
                values = [(v.name if same else self.unit.name(v.name, fin), e.value) for fin, e in enumerate(entries)]
                yield from ((code(name), stated(value, v.unit)) for name, value in (values[:1] if same else values)
                            if name not in {name for _, name, *_ in usual})

    def __repr__(self) -> str:
        return (f"<Response of {self.unit.model}: {self.excitation.title}, {len(self.time)} rows, "
                f"{len(self._all_columns)} columns>")

    def _repr_html_(self) -> str:
        rows = "".join(f"<tr><td>{'<td>'.join(map(escape, row))}" for row in self.lines())
        return f"<table><caption>{escape(self.excitation.title)}</caption>{rows}</table>"


def _history(v: Variable, time: Any, column: Any) -> str:
    """Return a discrete output as text: its value at the start and at each change, or of many changes at the last."""
    rows = np.flatnonzero(np.diff(column)) + 1
    changes = [f"{time[k]:g} s {v.in_words(column[k])}" for k in rows]
    if len(changes) > _MOST_CHANGES:
        changes = [f"{len(changes) - 1} changes", changes[-1]]
    return ", ".join([v.in_words(column[0]), *changes])


def panel_outputs(model: str) -> list[list[Variable]]:
    """Return the outputs of each panel: the fin port's one by one, then up to _MOST_PANELS with one unit each."""
    aside = {v.name for v in (*fin_port.OUTPUTS, *extension_outputs(model))}
    by_unit: dict[tuple[str, float], list[Variable]] = {}
    for v in get(model).outputs:
        if v.kind == "Real" and v.name not in aside:
            by_unit.setdefault(metrics.shown_output(v), []).append(v)
    port = (fin_port.FIN_ANGLE, fin_port.TRACKING_ERROR, fin_port.FIN_RATE, fin_port.HINGE_TORQUE)
    return [*([v] for v in port), *list(by_unit.values())[:_MOST_PANELS]]
