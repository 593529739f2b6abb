"""Fly the rocket: `python examples/jsbsim/fly.py --help`."""

from __future__ import annotations

import sys
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import typer

if __package__ in (None, ""):  # run as a file: modules are found from the folder above examples
    sys.path[0] = str(Path(__file__).resolve().parents[2])

EPILOG = ("Examples:\n\n  python examples/jsbsim/fly.py --output flight"
          "\n\n  python examples/jsbsim/fly.py --host all --manoeuvre aggressive --actuator stiff --no-convergence"
          "\n\n  python examples/jsbsim/fly.py --fmu My4.fmu --bus-resistance 0.05 --actuator fmu"
          "\n\n  python examples/jsbsim/fly.py --model all --manoeuvre aggressive --no-convergence"
          "\n\n  python examples/jsbsim/fly.py --model servo --hinge 46 --no-convergence"
          "\n\n  python examples/jsbsim/fly.py --actuator ideal --step 4 --output coarse --format npz")


class Actuator(str, Enum):
    """The actuators that move the fins."""

    IDEAL = "ideal"
    UNDELAYED = "second-order-undelayed"
    SECOND_ORDER = "second-order"
    FMU = "fmu"
    STIFF = "stiff"
    ALL = "all"


class Host(str, Enum):
    """The master that steps an archive's FMUs."""

    FMPY = "fmpy"
    LIBCOSIM = "libcosim"
    ECOS = "ecos"
    ALL = "all"


class Flown(str, Enum):
    """The manoeuvres."""

    GENTLE = "gentle"
    AGGRESSIVE = "aggressive"
    TIGHT = "tight"
    ALL = "all"


class Format(str, Enum):
    """File formats of trajectories."""

    CSV = "csv"
    NPZ = "npz"


def fly(
    fmu: Annotated[Path | None, typer.Option(help="FMU of four actuators of any model, or of a single one, "
                                             "which is then used four times.", metavar="FILE.fmu")] = None,
    model: Annotated[list[str] | None, typer.Option(
        "--model", "--models", help="Build actuators of this model with default parameters and fly them; repeatable. "
        "all: every actuator with a supply. Default without --fmu: nonlinear.",
        metavar="NAME|all")] = None,
    actuator: Annotated[Actuator, typer.Option(
        help="Actuators of the fins: ideal, second-order (a fit to the FMU), second-order-undelayed (without its "
             "delay), fmu, stiff (the FMU on a stiff bus) or all.", metavar="NAME")] = Actuator.ALL,
    manoeuvre: Annotated[Flown, typer.Option(help="gentle, aggressive, tight (aggressive with higher gains) or all.",
                                             metavar="NAME")] = Flown.ALL,
    bus_resistance: Annotated[float | None, typer.Option(
        help="Resistance of the bus's source in Ohm, 0 to 1. Default for an FMU of four on a bus: 0.02.",
        metavar="OHM")] = None,
    bus_voltage: Annotated[float | None, typer.Option(
        help="Voltage of the bus's source. Default: the start value of the FMU or archive.", metavar="V")] = None,
    mixing: Annotated[bool, typer.Option("--mixing", help="Let an FMU of four mix roll, pitch and yaw.")] = False,
    host: Annotated[Host | None, typer.Option(
        help="Also fly the four single FMUs of an SSP in this master: fmpy, libcosim, ecos or all.",
        metavar="NAME")] = None,
    ssp: Annotated[Path | None, typer.Option(help="Archive for --host. Default: one of four single FMUs of the model.",
                                             metavar="FILE.ssp")] = None,
    variant: Annotated[str, typer.Option(help="Variant of --ssp.", metavar="NAME")] = "nominal",
    step: Annotated[float, typer.Option(help="Communication step in ms; 4 ms must be a multiple.", min=0.01,
                                         metavar="MS")] = 1.0,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for page, figures and trajectories.",
                                         metavar="DIR")] = Path("jsbsim-flight"),
    kind: Annotated[Format, typer.Option("--format", help="Format of trajectories: csv or npz.",
                                         metavar="NAME")] = Format.CSV,
    guid: Annotated[str | None, typer.Option(help="Refuse an FMU of another GUID.", metavar="GUID")] = None,
    convergence: Annotated[bool, typer.Option(help="Measure convergence with the communication step (half a "
                                                   "minute).")] = True,
    hinge: Annotated[float, typer.Option(help="Position of the fins' hinges in % of the chord. The centre of pressure "
                                         "is at 46 to 48 %: hinges near it have small hinge moments.", min=25.0,
                                         max=47.0, metavar="PERCENT")] = 41.0,
) -> None:
    """Fly a finned rocket in JSBSim with ideal actuators, second-order actuators and FMUs of any model.

    Writes report.html, figures.json and the trajectories. Exit codes: 0 done, 2 an error.
    """
    from tempfile import TemporaryDirectory

    from emcas_fmu.commands.common import failures, out, progress_bar
    from emcas_fmu.errors import EmcasError
    from examples.jsbsim.report import write_report
    from examples.jsbsim.results import write_flights, write_json
    from examples.jsbsim.run import Options, every_model, run

    def chosen(kind: type[Enum], one: Enum | None) -> tuple[str, ...]:
        return tuple(each.value for each in kind if each.value != "all" and one and one.value in ("all", each.value))

    models = [each for name in model or () for each in (every_model() if name == "all" else (name,))]
    options = Options(chosen(Flown, manoeuvre), chosen(Actuator, actuator), step * 1e-3, fmu,
                      tuple(dict.fromkeys(models)), guid, bus_resistance, bus_voltage, mixing, chosen(Host, host), ssp,
                      variant, convergence, hinge / 100.0)
    with failures():
        if output.exists() and not output.is_dir():
            raise EmcasError(f"{output}: is a file; --output names a folder")
        output.mkdir(parents=True, exist_ok=True)
        with progress_bar() as progress, TemporaryDirectory() as folder:
            task = progress.add_task("", total=1.0)
            results = run(options, Path(folder),
                          lambda what, share: progress.update(task, description=what, completed=share))
        command = " ".join(["fly.py", *sys.argv[1:]])
        write_report(results, output / "report.html", command)
        write_json(results, output / "figures.json", command)
        written = write_flights(results, output, kind.value)
    _print(results)
    out.print(f"written {output / 'report.html'}, {output / 'figures.json'} and {len(written)} trajectories",
              highlight=False, soft_wrap=True)


def _print(results: Any) -> None:
    from emcas_fmu.commands.common import out
    from emcas_fmu.pages.terminal import table
    from examples.jsbsim.results import agreements, all_figures

    shown = {"attitude_error_rms_deg": "error, RMS [deg]", "attitude_difference_to_ideal_deg": "to ideal [deg]",
             "attitude_difference_to_second_order_deg": "to second order [deg]",
             "hinge_moment_largest_n_m": "hinge moment [N.m]", "saturated_percent": "at a limit [%]",
             "energy_drawn_j": "energy [J]", "bus_voltage_lowest_v": "lowest voltage [V]"}
    for manoeuvre, flown in all_figures(results).items():
        out.print(table(["actuator", *(f">{heading}" for heading in shown.values())],
                        ([actuator, *(f"{figures[k]:.3g}" if k in figures else None for k in shown)]
                         for actuator, figures in flown.items()), manoeuvre,
                        whole=(0,), plain=True))
    for manoeuvre, by_master in agreements(results).items():
        first = next(iter(by_master))
        for master, a in by_master.items():
            out.print(f"{manoeuvre}: {results.labels.get(master, 'SSP in ' + master)}"
                      + (f": from {first} fins {a.fins:.2g} rad, attitude {a.attitude:.2g} rad"
                         + (", all bits the same" if a.identical else "") if master != first else ""),
                      highlight=False, soft_wrap=True)


def main() -> None:
    """Run the program."""
    app = typer.Typer(add_completion=False, rich_markup_mode="rich", pretty_exceptions_enable=False)
    app.command(epilog=EPILOG)(fly)
    app()


if __name__ == "__main__":
    main()
