"""`emcas envelope`: compute the torque of motor and drive over speed, continuous and for a short time."""

from __future__ import annotations

from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.markup import escape
from rich.table import Table

from ..errors import EmcasError
from ..units import RPM
from . import common

if TYPE_CHECKING:
    from ..studies.analysis.envelope import Envelope

EPILOG = common.examples("envelope", "", '--duration "30 s" --plot envelope.svg --output envelope.csv',
                         "-p my_motor.toml --duration 500ms --preload 0.8 --json envelope.json")
_ROWS = {"current / A": "current_a", "limited by": "bound_by", "  heat / A": "heat_current_a",
         "  i2t / A": "i2t_current_a", "  peak / A": "peak_current_a", "torque at standstill / N.m": "stall_torque_nm",
         "voltage limits from / rpm": "corner_speed_rad_per_s", "no-load speed / rpm": "no_load_speed_rad_per_s",
         "winding at the end / degC": "winding_degc", "case at the end / degC": "case_degc"}


def envelope(
    parameters: common.ParametersOption = None,
    model: common.ModelOption = "nonlinear+heat",
    duration: Annotated[str, common.value("Duration of the short-term torque, with its unit.", "TIME")] = "10 s",
    preload: Annotated[float, common.value("Current that has flowed for a long time before, as a share of the "
                                           "continuous one. 0: the motor is at ambient temperature.", "SHARE")] = 0.0,
    output: Annotated[Path | None, common.output_option("Write the curves to this CSV file (in SI).", ".csv")] = None,
    plot: Annotated[Path | None, common.plot_option("Plot the envelopes")] = None,
    as_json: Annotated[Path | None, common.json_option("Write currents, temperatures and speeds to this file.")] = None,
) -> None:
    """Compute torque-speed envelopes from limits of winding temperature, I2t, peak current and voltage."""
    from ..bench.conditions import resting_on
    from ..bench.writers import write_csv
    from ..units import UnitError, quantity

    common.check_outputs(output, plot, as_json, inputs=(parameters,))
    try:
        seconds = quantity(duration, "", "s")
    except UnitError as error:
        raise EmcasError(f"--duration {duration}: {error}") from error
    from ..studies.analysis import envelope as study

    chosen = common.parameter_set(parameters, model)
    computed = study.envelope(chosen, seconds, preload)
    figures = _figures(computed)
    common.write_results(_columns(computed), (output, write_csv))
    common.write_results(computed, (plot, lambda e, path: study.write_picture(e, path, chosen)))
    common.write_json(figures, as_json)
    common.out.print(_table(figures))
    for each in resting_on({"marked figures": tuple(dict.fromkeys(chain(*computed.estimates.values())))}):
        common.say(escape(each))
    common.print_written(output, plot, as_json)


def _figures(e: Envelope) -> dict[str, Any]:
    return {"duration_s": e.duration, "preload": e.preload,
            **{name: {"current_a": c.current, "bound_by": c.bound_by,
                      **{f"{cause}_current_a": current for cause, current in c.currents.items()},
                      "stall_torque_nm": c.torque[0], "corner_speed_rad_per_s": c.corner_speed,
                      "no_load_speed_rad_per_s": c.no_load_speed,
                      "winding_degc": c.winding, "case_degc": c.case} for name, c in e.curves.items()},
            "estimates": {key: list(names) for key, names in e.estimates.items()}}


def _columns(e: Envelope) -> dict[str, Any]:
    """Return the motor's speed [rad/s], both envelopes [N.m], then the limits of each envelope [N.m]."""
    return {"motor_speed": e.speed, **{name: curve.torque for name, curve in e.curves.items()},
            **{f"{name}.{cause}": torque for name, curve in e.curves.items() for cause, torque in curve.limits.items()}}


def _table(f: dict[str, Any]) -> Table:
    from ..bench.conditions import ESTIMATE

    preload = f", from {f['preload']:g} of the continuous current" if f["preload"] else ""

    def cells(label: str, key: str) -> list[Any]:
        values = [f[curve][key] for curve in ("continuous", "short_term")]
        return [label + ESTIMATE * (key in f["estimates"]), *(RPM * x if "rpm" in label else x for x in values)]

    return common.table(["", ">continuous", f">{f['duration_s']:g} s{preload}"],
                        [cells(*row) for row in _ROWS.items()], "torque-speed envelope")
