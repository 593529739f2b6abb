"""The page of a run, with pictures and figures in one file."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from importlib.metadata import version
from pathlib import Path

from emcas_fmu.pages.page import write_page
from emcas_fmu.pages.provenance import made_by
from emcas_fmu.plotting import plots
from emcas_fmu.studies.fitting import FITTED

from .convergence import REFERENCE
from .pictures import convergence, of_manoeuvre
from .results import Results, agreements, all_figures

ROWS = (("attitude_error_rms_deg", "attitude error, RMS", "°", 2),
        ("attitude_error_last_half_second_deg", "largest attitude error in the last half second", "°", 2),
        ("attitude_error_end_deg", "attitude error at the end", "°", 3),
        ("attitude_difference_to_ideal_deg", "largest difference of attitude to the ideal actuator", "°", 3),
        ("attitude_difference_to_second_order_deg", "largest difference of attitude to the second-order one", "°", 3),
        ("attitude_difference_to_stiff_deg", "largest difference of attitude to the stiff bus", "°", 3),
        ("incidence_largest_deg", "largest incidence", "°", 1),
        ("lateral_acceleration_largest_m_s2", "largest lateral acceleration of the centre of gravity", "m/s²", 0),
        ("fin_angle_largest_deg", "largest fin angle", "°", 1),
        ("fin_rate_largest_deg_s", "largest fin rate", "°/s", 0),
        ("hinge_moment_largest_n_m", "largest hinge moment", "N·m", 0),
        ("saturated_percent", "limited, mean over the fins", "%", 1), ("power_largest_w", "largest power", "W", 0),
        ("bus_voltage_lowest_v", "lowest voltage at the drives", "V", 2),
        ("bus_current_largest_a", "largest current of the bus", "A", 1),
        ("line_pressure_lowest_mpa", "lowest pressure at the valves", "MPa", 2),
        ("line_flow_largest_l_min", "largest flow of the pressure line", "l/min", 1),
        ("energy_drawn_j", "energy drawn", "J", 1), ("energy_returned_j", "energy returned", "J", 1),
        ("speed_end_m_s", "speed at the end", "m/s", 1))
VALID = 25.0  # deg, largest incidence for which the aircraft file is valid
_NO_STEPS = {"ideal": {"fin_rate_largest_deg_s", "power_largest_w", "energy_drawn_j", "energy_returned_j"}}


def _pictures(drawings: Iterable[plots.Drawing]) -> list[plots.Picture]:
    """Return static pictures: a flight has too many points for curves that a script draws."""
    return [picture._replace(curves="") for picture in plots.pictures(drawings)]


def write_report(results: Results, path: Path, command: str) -> None:
    """Write the page of a run with this `command` to `path`."""
    converged = list(results.convergence.values())[:1]
    with made_by(shlex.split(command)):
        write_page(
            path, Path(__file__).with_name("report.html.j2"), [], results=results, figures=all_figures(results),
            headings={name: [results.labels[each] for each in flown] for name, flown in results.flights.items()},
            pictures={name: _pictures(of_manoeuvre(results, name)) for name in results.flights},
            converged=_pictures(convergence(results) for _ in converged),
            steps=[f"{1e3 * step:g} ms" for each in converged for step in each.steps],
            convergence=[(name, quantity, errors, c.order(errors)) for name, c in results.convergence.items()
                         for quantity, errors in (("attitude", c.attitude), ("fins", c.fins))],
            agreements=[(name, master, each, not k) for name, found in agreements(results).items()
                        for k, (master, each) in enumerate(found.items())],
            rows=ROWS, labels=results.labels, meaningless=_NO_STEPS, jsbsim=version("jsbsim"), reference=REFERENCE,
            valid=VALID, second_order=[results.second_order.parameters.values[name] for name in FITTED]
            if results.second_order else None)
