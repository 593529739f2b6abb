"""`emcas envelope`: torque against speed of motor and drive, continuous and for a short time."""

from __future__ import annotations

from itertools import chain
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from ..errors import EmcasError
from ..support.writing import whole
from . import common

if TYPE_CHECKING:
    from ..studies.analysis.envelope import Envelope

EPILOG = ("Examples:\n\n  emcas envelope"
          "\n\n  emcas envelope --duration \"30 s\" --plot envelope.svg --output envelope.csv"
          "\n\n  emcas envelope -p my_motor.toml --duration 500ms --preload 0.8 --json envelope.json")


def envelope(
    parameters: common.ParametersOption = None,
    model: common.ModelOption = "nonlinear+heat",
    duration: Annotated[str, typer.Option(help="How long the short-term torque is wanted, with its unit.",
                                          metavar="TIME")] = "10 s",
    preload: Annotated[float, typer.Option(help="Share of the continuous current, the least there is, that flowed "
                                                "before, for long. 0: from ambient.", metavar="SHARE")] = 0.0,
    output: Annotated[Path | None, common.csv_option("Write the curves to this CSV file, SI.")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the envelopes: .html, .svg, .png or .pdf.",
                                              metavar="FILE")] = None,
    as_json: Annotated[Path | None, common.json_option("Write currents, temperatures and speeds to this file.")] = None,
) -> None:
    """Torque-speed envelopes of motor and drive: within winding temperature, I2t, peak current and voltage."""
    from ..bench.conditions import resting_on
    from ..bench.writers import write_json
    from ..units import UnitError, quantity

    with common.failures():
        common.check_outputs(output, plot, as_json, inputs=parameters or ())
        try:
            seconds = quantity(duration, "", "s")
        except UnitError as error:
            raise EmcasError(f"--duration {duration}: {error}") from error
        from ..figures.plots import check_ending
        from ..studies.analysis import envelope as study

        check_ending(plot)
        chosen = common.parameter_set(parameters, model)
        computed = study.envelope(chosen, seconds, preload)
        if output:
            _write_csv(computed, output)
        if plot:
            study.write_picture(computed, plot, chosen)
        if as_json:
            write_json(_figures(computed), as_json)
    common.out.print(_table(computed))
    for each in resting_on({"what is marked": tuple(dict.fromkeys(chain(*computed.estimates.values())))}):
        common.say(escape(each))
    common.print_written(output, plot, as_json)


def _figures(e: Envelope) -> dict[str, Any]:
    return {"duration_s": e.duration, "preload": e.preload, "no_load_speed_rad_per_s": e.speed[-1],
            **{name: {"current_a": c.current, "bound_by": c.bound_by,
                      **{f"{cause}_current_a": current for cause, current in c.currents.items()},
                      "stall_torque_nm": c.torque[0], "corner_speed_rad_per_s": c.corner_speed,
                      "winding_degc": c.winding, "case_degc": c.case} for name, c in e.curves.items()},
            "estimates": {key: list(names) for key, names in e.estimates.items()}}


def _write_csv(e: Envelope, path: Path) -> None:
    """Speed [rad/s], both envelopes [N.m], then each limit of each."""
    import numpy as np

    columns = {"motor_speed": e.speed, **{name: curve.torque for name, curve in e.curves.items()}}
    for name, curve in e.curves.items():
        columns |= {f"{name}.{cause}": torque for cause, torque in curve.limits.items()}
    with whole(path) as file:
        np.savetxt(file, np.column_stack(list(columns.values())), fmt="%.17g", delimiter=",", header=",".join(columns),
                   comments="")


def _table(e: Envelope) -> Table:
    from ..bench.conditions import ESTIMATE
    from ..pages.numbers import number
    from ..studies.analysis.envelope import TORQUE

    preload = f", from {e.preload:g} of the continuous current" if e.preload else ""
    table = Table("", "continuous", f"{e.duration:g} s{preload}", title="torque-speed envelope", title_justify="left")
    curves = e.curves.values()
    rows: list[tuple[str, str, list[Any]]] = [
        ("current / A", "current_a", [c.current for c in curves]),
        ("limited by", "", [c.bound_by for c in curves]),
        *((f"  {cause} / A", f"{cause}_current_a", [c.currents[cause] for c in curves])
          for cause in e.continuous.currents),
        ("torque at standstill / N.m", TORQUE, [c.torque[0] for c in curves]),
        ("voltage limits from / rpm", "corner_speed_rad_per_s", [c.corner_speed * 30.0 / pi for c in curves]),
        ("no-load speed / rpm", "no_load_speed_rad_per_s", [e.speed[-1] * 30.0 / pi] * 2),
        ("winding, case then / degC", "winding_degc", [f"{c.winding:.4g}, {c.case:.4g}" for c in curves])]
    for label, key, values in rows:
        table.add_row(label + ESTIMATE * (key in e.estimates),
                      *(value if isinstance(value, str) else number(value) for value in values))
    return common.right_aligned(table)
