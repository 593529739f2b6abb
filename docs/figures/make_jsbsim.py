"""Make the picture and the tables of examples/jsbsim/README.md: `python docs/figures/make_jsbsim.py [kinds|servo]...`.

The rocket flies with every kind of actuator, and with servos at several hinge positions. This takes some minutes, and
needs JSBSim and a C compiler.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from make_tables import main, markdown, save

from emcas_fmu.plotting.plots import style

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from examples.jsbsim.pictures import kinds
from examples.jsbsim.results import FMU, IDEAL, SECOND_ORDER, Results, all_figures, kept, power_kind
from examples.jsbsim.run import Options, every_model, run

DOCUMENT = "../examples/jsbsim/README.md"
# Other models of the electromechanical actuator, and the kind that is sized for another fin.
LEFT_OUT = ("linear", "ristanovic", "habibi", "ozkan", "servo")
MANOEUVRE, GENTLE = "aggressive", "gentle"
SERVO, HINGES = "servo", (0.41, 0.46)


def models() -> tuple[str, ...]:
    """Return the names of the kinds that fly."""
    return tuple(name for name in every_model() if name not in LEFT_OUT)


def fly(*names: str, hinge: float = HINGES[0]) -> Results:
    """Return the flights of models, with the hinges at a share of the chord."""
    options = Options((MANOEUVRE, GENTLE), (IDEAL, SECOND_ORDER, FMU), models=names, convergence=False, hinge=hinge)
    with TemporaryDirectory() as folder:
        return run(options, Path(folder), lambda what, share: print(what) if share == 0.0 else None)


def table(results: Results) -> str:
    """Return the table of attitude, power and energy of each kind."""
    figures = all_figures(results)
    rows = []
    for actuator, flight in results.flights[MANOEUVRE].items():
        if actuator == IDEAL:
            continue
        aggressive, gentle = (figures[name][actuator] for name in (MANOEUVRE, GENTLE))
        rows.append((f"`{actuator}`", power_kind(flight), _difference(aggressive), _end(aggressive),
                     _energy(aggressive, "drawn"),
                     _energy(aggressive, "returned"), f"{1e-3 * aggressive['power_largest_w']:.2g} kW",
                     _difference(gentle) + ("" if kept(gentle) else ", **lost**"), _energy(gentle, "drawn")))
    return markdown(("actuator", "power", "attitude from ideal", "attitude in the end", "drawn", "returned",
                     "peak", "gentle: from ideal", "gentle: drawn"), rows)


def servo_table() -> str:
    """Return the table of the servo's flights, by manoeuvre and hinge position."""
    rows = []
    for hinge in HINGES:
        figures = all_figures(fly(SERVO, hinge=hinge))
        for name in (GENTLE, MANOEUVRE):
            ideal, servo = figures[name][IDEAL], figures[name][SERVO]
            rows.append((name, f"{100.0 * hinge:g} %", f"{ideal['hinge_moment_largest_n_m']:.0f} N·m",
                         f"{servo['fin_error_rms_deg']:.1f}°, {servo['fin_error_largest_deg']:.1f}°",
                         f"{servo['fin_rate_largest_deg_s']:.0f}°/s", _difference(servo), _end(servo),
                         _energy(servo, "drawn")))
    return markdown(("manoeuvre", "hinges at", "largest moment on ideal fins", "fin from command: rms, largest",
                     "fin rate", "attitude from ideal", "attitude in the end", "drawn"), rows)


def _end(figures: Mapping[str, float]) -> str:
    return f"kept, to {figures['attitude_error_last_half_second_deg']:.1f}°" if kept(figures) else "**lost**"


def _difference(figures: Mapping[str, float]) -> str:
    difference = figures["attitude_difference_to_ideal_deg"]
    return f"{difference:.1f}°" if difference >= 10.0 else f"{difference:.2f}°"


def _energy(figures: Mapping[str, float], direction: str) -> str:
    joules = figures[f"energy_{direction}_j"]
    return f"{1e-3 * joules:.2g} kJ" if joules >= 1e3 else f"{joules:.0f} J" if joules >= 10.0 else f"{joules:.2g} J"


def kinds_table() -> str:
    """Return the table of the kinds, and write the picture."""
    flown = fly(*models())
    with style():
        save(kinds(flown, MANOEUVRE).figure, "jsbsim_kinds")
    return table(flown)


if __name__ == "__main__":
    blocks = {"kinds": kinds_table, "servo": servo_table}
    sys.exit(main(False, {DOCUMENT: {name: blocks[name] for name in sys.argv[1:] or blocks}}, "make_jsbsim.py"))
