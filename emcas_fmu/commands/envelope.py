"""`emcas envelope`: torque against speed, for any time and for a while."""

from __future__ import annotations

import json
from math import pi
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from ..errors import EmcasError
from ..parameters import load_parameters
from .common import ModelOption, ParametersOption, check_outputs, failures, out

if TYPE_CHECKING:
    from ..studies.analysis.envelope import Curve, Envelope

EPILOG = ("Examples:\n\n  emcas envelope"
          "\n\n  emcas envelope --duration \"30 s\" --plot envelope.svg --output envelope.csv"
          "\n\n  emcas envelope -p my_motor.toml --duration 500ms --preload 0.8 --json envelope.json")
_NAMES = ("continuous", "short_term")


def envelope(
    parameters: ParametersOption = None,
    model: ModelOption = "nonlinear+heat",
    duration: Annotated[str, typer.Option(help="How long the short-term torque is wanted, with its unit.",
                                          metavar="TIME")] = "10 s",
    preload: Annotated[float, typer.Option(help="Share of the continuous current, the least there is, that flowed "
                                                "before, for long. 0: from ambient.", metavar="SHARE")] = 0.0,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Write the curves to this CSV file, SI.",
                                                metavar="FILE")] = None,
    plot: Annotated[Path | None, typer.Option(help="Draw the envelopes: .html, .svg, .png or .pdf.",
                                              metavar="FILE")] = None,
    as_json: Annotated[Path | None, typer.Option("--json", help="Write currents, temperatures and speeds to this file.",
                                                 metavar="FILE")] = None,
) -> None:
    """Torque-speed envelopes of motor and drive: within winding temperature, I2t, peak current and voltage."""
    from ..units import UnitError, quantity

    with failures():
        check_outputs(output, plot, as_json, inputs=parameters or ())
        try:
            seconds = quantity(duration, "", "s")
        except UnitError as error:
            raise EmcasError(f"--duration {duration}: {error}") from error
        from ..plots import check_ending
        from ..studies.analysis.envelope import envelope as compute

        check_ending(plot)
        found = compute(load_parameters(parameters, model=model), seconds, preload)
        if output:
            _write_csv(found, output)
        if plot:
            from ..studies.analysis.envelope import write_picture

            write_picture(found, plot)
        if as_json:
            as_json.write_text(json.dumps(_figures(found), indent=1), encoding="utf-8")
    out.print(_table(found))
    for path in (output, plot, as_json):
        if path:
            out.print(f"written {escape(str(path))}", highlight=False, soft_wrap=True)


def _figures(found: Envelope) -> dict[str, Any]:
    def one(c: Curve) -> dict[str, Any]:
        return {"current_a": c.current, "bound_by": c.bound_by,
                **{f"{cause}_current_a": current for cause, current in c.currents.items()},
                "stall_torque_nm": float(c.torque[0]), "corner_speed_rad_per_s": c.corner_speed,
                "winding_degc": c.winding, "case_degc": c.case}

    return {"duration_s": found.duration, "preload": found.preload, "no_load_speed_rad_per_s": float(found.speed[-1]),
            **{name: one(getattr(found, name)) for name in _NAMES}}


def _write_csv(found: Envelope, path: Path) -> None:
    """Speed [rad/s], both envelopes [N.m], then each limit of each."""
    import numpy as np

    columns = {"motor_speed": found.speed, **{name: getattr(found, name).torque for name in _NAMES}}
    for name in _NAMES:
        columns |= {f"{name}.{cause}": torque for cause, torque in getattr(found, name).limits.items()}
    np.savetxt(path, np.column_stack(list(columns.values())), fmt="%.17g", delimiter=",", header=",".join(columns),
               comments="")


def _table(found: Envelope) -> Table:
    preload = f", from {found.preload:g} of the continuous current" if found.preload else ""
    table = Table("", "continuous", f"{found.duration:g} s{preload}", title="torque-speed envelope",
                  title_justify="left")
    curves = (found.continuous, found.short_term)
    rows = (
        ("current / A", [f"{c.current:.4g}" for c in curves]), ("limited by", [c.bound_by for c in curves]),
        *((f"  {cause} / A", [f"{c.currents[cause]:.4g}" for c in curves]) for cause in curves[0].currents),
        ("torque at standstill / N.m", [f"{c.torque[0]:.4g}" for c in curves]),
        ("voltage limits from / rpm", [f"{c.corner_speed * 30.0 / pi:.4g}" for c in curves]),
        ("no-load speed / rpm", [f"{found.speed[-1] * 30.0 / pi:.4g}"] * 2),
        ("winding, case then / degC", [f"{c.winding:.4g}, {c.case:.4g}" for c in curves]))
    for label, values in rows:
        table.add_row(label, *values)
    for column in table.columns[1:]:
        column.justify = "right"
    return table
