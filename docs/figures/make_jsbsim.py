"""The picture and the tables in examples/jsbsim/README.md: `python docs/figures/make_jsbsim.py [kinds|servo]...`.

Flies the rocket on every kind of actuator, and on servos with hinges at several places, which takes some minutes, and
needs JSBSim and a C compiler.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from make_tables import main, markdown

from emcas_fmu.figures.plots import style

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from examples.jsbsim.pictures import kinds
from examples.jsbsim.results import FMU, IDEAL, SECOND_ORDER, Results, all_figures, kept, power_kind
from examples.jsbsim.run import Options, every_model, run

DOCUMENT = "../examples/jsbsim/README.md"
# Other models of the electromechanical actuator, one of them without any limit; and what is sized for another fin.
LEFT_OUT = ("linear", "ristanovic", "habibi", "ozkan", "servo")
DRAWN, BESIDE = "aggressive", "gentle"
SERVO, HINGES = "servo", (0.41, 0.46)


def models() -> tuple[str, ...]:
    """The kinds."""
    return tuple(name for name in every_model() if name not in LEFT_OUT)


def fly(*names: str, hinge: float = HINGES[0]) -> Results:
    """The flights of these models."""
    options = Options((DRAWN, BESIDE), (IDEAL, SECOND_ORDER, FMU), models=names, convergence=False, hinge=hinge)
    with TemporaryDirectory() as folder:
        return run(options, Path(folder), lambda what, share: print(what) if share == 0.0 else None)


def draw(results: Results) -> None:
    """Write the picture."""
    with style():
        kinds(results, DRAWN).figure.savefig(Path(__file__).parent / "jsbsim_kinds.png", dpi=110, facecolor="white",
                                         metadata={"Software": None})


def table(results: Results) -> str:
    """What each kind does to the attitude, and what it draws."""
    found = all_figures(results)
    rows = []
    for actuator, flight in results.flights[DRAWN].items():
        if actuator == IDEAL:
            continue
        drawn, beside = (found[name][actuator] for name in (DRAWN, BESIDE))
        rows.append((f"`{actuator}`", power_kind(flight), _apart(drawn), _end(drawn), _energy(drawn, "drawn"),
                     _energy(drawn, "returned"), f"{1e-3 * drawn['power_largest_w']:.2g} kW",
                     _apart(beside) + ("" if kept(beside) else ", **lost**"), _energy(beside, "drawn")))
    return markdown(("actuator", "power", "attitude from ideal", "attitude in the end", "drawn", "returned",
                     "peak", "gentle: from ideal", "gentle: drawn"), rows)


def servo_table() -> str:
    """What the servo flies, by manoeuvre and place of the hinges."""
    rows = []
    for hinge in HINGES:
        found = all_figures(fly(SERVO, hinge=hinge))
        for name in (BESIDE, DRAWN):
            ideal, servo = found[name][IDEAL], found[name][SERVO]
            rows.append((name, f"{100.0 * hinge:g} %", f"{ideal['hinge_moment_largest_n_m']:.0f} N·m",
                         f"{servo['fin_error_rms_deg']:.1f}°, {servo['fin_error_largest_deg']:.1f}°",
                         f"{servo['fin_rate_largest_deg_s']:.0f}°/s", _apart(servo), _end(servo),
                         _energy(servo, "drawn")))
    return markdown(("manoeuvre", "hinges at", "largest moment on ideal fins", "fin from command: rms, largest",
                     "fin rate", "attitude from ideal", "attitude in the end", "drawn"), rows)


def _end(figures: Mapping[str, float]) -> str:
    return f"kept, to {figures['attitude_error_last_half_second_deg']:.1f}°" if kept(figures) else "**lost**"


def _apart(figures: Mapping[str, float]) -> str:
    apart = figures["attitude_difference_to_ideal_deg"]
    return f"{apart:.1f}°" if apart >= 10.0 else f"{apart:.2f}°"


def _energy(figures: Mapping[str, float], what: str) -> str:
    joules = figures[f"energy_{what}_j"]
    return f"{1e-3 * joules:.2g} kJ" if joules >= 1e3 else f"{joules:.0f} J" if joules >= 10.0 else f"{joules:.2g} J"


def kinds_table() -> str:
    """The table of the kinds; draws the picture."""
    flown = fly(*models())
    draw(flown)
    return table(flown)


if __name__ == "__main__":
    blocks = {"kinds": kinds_table, "servo": servo_table}
    sys.exit(main(False, {DOCUMENT: {name: blocks[name] for name in sys.argv[1:] or blocks}}, "make_jsbsim.py"))
