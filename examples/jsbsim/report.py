"""The page of a run: pictures and figures, with nothing outside it."""

from __future__ import annotations

from importlib.metadata import version
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined, select_autoescape

from emcas_fmu import __version__
from emcas_fmu.figures.plots import style, svg
from emcas_fmu.studies.fitting import NAMES

from .convergence import REFERENCE
from .pictures import convergence, of_manoeuvre
from .results import Results, agreements, all_figures

ROWS = (("attitude_error_rms_deg", "attitude error, RMS", "deg", 2),
        ("attitude_error_last_half_second_deg", "largest attitude error in the last half second", "deg", 2),
        ("attitude_error_end_deg", "attitude error at the end", "deg", 3),
        ("attitude_difference_to_ideal_deg", "largest difference of attitude to the ideal actuator", "deg", 3),
        ("attitude_difference_to_second_order_deg", "largest difference of attitude to the second-order one", "deg", 3),
        ("attitude_difference_to_stiff_deg", "largest difference of attitude to the stiff bus", "deg", 3),
        ("incidence_largest_deg", "largest incidence", "deg", 1),
        ("lateral_acceleration_largest_m_s2", "largest lateral acceleration of the centre of gravity", "m/s²", 0),
        ("fin_angle_largest_deg", "largest fin angle", "deg", 1),
        ("fin_rate_largest_deg_s", "largest fin rate", "deg/s", 0),
        ("hinge_moment_largest_n_m", "largest hinge moment", "N·m", 0),
        ("saturated_percent", "limited, mean over the fins", "%", 1), ("power_largest_w", "largest power", "W", 0),
        ("bus_voltage_lowest_v", "lowest voltage at the drives", "V", 2),
        ("bus_current_largest_a", "largest current of the bus", "A", 1),
        ("line_pressure_lowest_mpa", "lowest pressure at the valves", "MPa", 2),
        ("line_flow_largest_l_min", "largest flow of the pressure line", "l/min", 1),
        ("energy_drawn_j", "energy drawn", "J", 1), ("energy_returned_j", "energy returned", "J", 1),
        ("speed_end_m_s", "speed at the end", "m/s", 1))
VALID = 25.0  # deg of incidence, of the aircraft file
_NO_STEPS = {"ideal": {"fin_rate_largest_deg_s", "power_largest_w", "energy_drawn_j", "energy_returned_j"}}


def write_report(results: Results, path: Path, command: str) -> None:
    """Write the page."""
    environment = Environment(loader=FileSystemLoader(Path(__file__).parent), undefined=StrictUndefined,
                              trim_blocks=True, lstrip_blocks=True, autoescape=select_autoescape(["html.j2"]))
    with style():
        drawn = {name: [(svg(picture, f"{name}: {title}"), title, caption)
                        for picture, title, caption in of_manoeuvre(results, name)] for name in results.flights}
        converged = convergence(results) if results.convergence else None
        picture = (svg(converged[0], "Convergence"), converged[2]) if converged else None
    page = environment.get_template("report.html.j2").render(
        results=results, figures=all_figures(results), drawn=drawn, converged=picture, rows=ROWS, labels=results.labels,
        agreements=agreements(results), meaningless=_NO_STEPS, command=command, version=__version__,
        jsbsim=version("jsbsim"), reference=REFERENCE, valid=VALID,
        second_order=[fit.parameters.values[name] for name in NAMES] if (fit := results.second_order) else None)
    path.write_text(page, encoding="utf-8", newline="\n")
