"""The picture and the table of all kinds in examples/jsbsim/README.md: `python docs/figures/make_jsbsim.py`.

Flies the rocket on every kind of actuator, which takes some minutes, and needs JSBSim and a C compiler.
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


def models() -> tuple[str, ...]:
    """The kinds."""
    return tuple(name for name in every_model() if name not in LEFT_OUT)


def fly() -> Results:
    """The flights."""
    options = Options((DRAWN, BESIDE), (IDEAL, SECOND_ORDER, FMU), models=models(), convergence=False)
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
        rows.append((f"`{actuator}`", power_kind(flight), _apart(drawn),
                     f"kept, to {drawn['attitude_error_last_half_second_deg']:.1f}°" if kept(drawn) else "**lost**",
                     _energy(drawn, "drawn"), _energy(drawn, "returned"), f"{1e-3 * drawn['power_largest_w']:.2g} kW",
                     _apart(beside) + ("" if kept(beside) else ", **lost**"), _energy(beside, "drawn")))
    return markdown(("actuator", "power", "attitude from ideal", "attitude in the end", "drawn", "returned",
                     "peak", "gentle: from ideal", "gentle: drawn"), rows)


def _apart(figures: Mapping[str, float]) -> str:
    apart = figures["attitude_difference_to_ideal_deg"]
    return f"{apart:.1f}°" if apart >= 10.0 else f"{apart:.2f}°"


def _energy(figures: Mapping[str, float], what: str) -> str:
    joules = figures[f"energy_{what}_j"]
    return f"{1e-3 * joules:.2g} kJ" if joules >= 1e3 else f"{joules:.0f} J" if joules >= 10.0 else f"{joules:.2g} J"


if __name__ == "__main__":
    flown = fly()
    draw(flown)
    sys.exit(main(False, {DOCUMENT: {"kinds": lambda: table(flown)}}, "make_jsbsim.py"))
