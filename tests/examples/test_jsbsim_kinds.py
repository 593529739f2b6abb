"""The rocket with other kinds of actuators: their supplies, and the comparison of their flights."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting.plots import style
from examples.jsbsim.actuators import Ideal
from examples.jsbsim.flight import MANOEUVRES
from examples.jsbsim.fmu import Fmu
from examples.jsbsim.masters import InMaster, write_archive
from examples.jsbsim.pictures import kinds
from examples.jsbsim.report import write_report
from examples.jsbsim.results import (
    FMU,
    IDEAL,
    SECOND_ORDER,
    Results,
    Unit,
    all_figures,
    figures,
    fins,
    kept,
    write_flights,
    write_json,
)
from examples.jsbsim.run import Options, every_model, run
from examples.jsbsim.vehicle import Array
from tests.docs.recipes import ROOT
from tests.docs.test_tables import script

from .conftest import Doctor
from .flying import SHORT, apart, flown

DESCRIPTION = "modelDescription.xml"
HYDRAULIC = "electrohydraulic"


def refused(options: Options, folder: Path, message: str) -> None:
    """Check that a run is refused with the message before any flight."""
    with pytest.raises(EmcasError, match=message):
        run(options, folder, lambda what, share: None)


@pytest.fixture(scope="module")
def flight(hydraulic: Path) -> Mapping[str, Array]:
    """A short flight with four electrohydraulic actuators."""
    return flown(Fmu(hydraulic))


@pytest.mark.slow
def test_flight_with_hydraulic_actuators_on_a_pressure_line(hydraulic: Path, flight: Mapping[str, Array]) -> None:
    """The pressure is that of the parameter set; the flow is power over pressure.

    Because of a delay of about 10 ms the attitude differs from that with ideal fins by up to half the step of 8 deg.
    """
    pressure = load_parameters(model=HYDRAULIC).values["hydraulic_supply.pressure"]
    assert Fmu(hydraulic).model == HYDRAULIC
    assert np.all(flight["line_pressure_pa"] == pressure)
    np.testing.assert_allclose(flight["line_flow_m3_s"] * pressure, flight["power_w"], rtol=1e-12)  # rounding
    assert "bus_voltage_v" not in flight
    # A valve returns no oil to the pressure line.
    assert flight["power_w"].min() >= 0.0
    assert flight["power_w"].max() > 100.0
    found = figures(flight, 1e-3, {IDEAL: flown(Ideal())})
    assert found["attitude_difference_to_ideal_deg"] < 4.0
    assert np.ptp(fins(flight, "fin{}_rad")) > 0.2


def test_power_of_actuators_without_supply_is_the_work_against_hinge_moments(tmp_path: Path) -> None:
    path = build(load_parameters(model="second-order"), tmp_path / "other.fmu", fins=4).path
    found = flown(Fmu(path), replace(SHORT, duration=0.2))
    moments = np.column_stack([np.full(4, np.nan), fins(found, "hinge{}_n_m")[:, :-1]])  # at the beginning of each step
    work = -np.sum(fins(found, "fin_rate{}_rad_s") * moments, axis=0)[1:]
    np.testing.assert_allclose(found["power_w"][1:], work, rtol=0, atol=1e-9)  # rounding of 1 kW
    assert np.abs(work).max() > 10.0
    assert not {"bus_voltage_v", "line_pressure_pa"} & found.keys()


def test_fmu_of_four_fins_with_a_pressure_line_has_the_lines_outputs(four: Path, doctored: Doctor) -> None:
    """The FMU's bus is renamed to a pressure line."""
    other = doctored(four, DESCRIPTION, 'name="supply_voltage"', 'name="supply_pressure"', 'name="bus_voltage"',
                     'name="line_pressure"', 'name="bus_current"', 'name="line_flow"', 'unit="V"', 'unit="Pa"',
                     'unit="A"', 'unit="m3/s"', 'name="V"', 'name="Pa"', 'name="A"', 'name="m3/s"')
    manoeuvre = replace(SHORT, duration=0.1)
    bus, line = flown(Fmu(four), manoeuvre), flown(Fmu(other), manoeuvre)
    assert np.array_equal(line["line_pressure_pa"], bus["bus_voltage_v"])
    assert np.array_equal(line["line_flow_m3_s"], bus["bus_current_a"])
    assert "bus_voltage_v" not in line
    assert apart(bus, line) == 0.0


@pytest.mark.parametrize(("words", "message"), [
    (('unit="Pa"', 'unit="V"', 'name="Pa"', 'name="V"'),
     "source -> supply_pressure: supply_pressure is Real in V, not Real in Pa"),
    (('name="supply_pressure"', 'name="pressure"'), "has supply_power and no supply_voltage or supply_pressure"),
])
def test_error_names_the_wrong_connection_of_the_supply(
        words: tuple[str, ...], message: str, hydraulic: Path, doctored: Doctor) -> None:
    with pytest.raises(EmcasError, match=re.escape(message)):
        Fmu(doctored(hydraulic, DESCRIPTION, *words))


def test_bus_voltage_of_an_actuator_without_a_bus_is_refused(hydraulic: Path, tmp_path: Path) -> None:
    archive = write_archive(tmp_path / "EMCAS.ssp", hydraulic)
    for make in (lambda: Fmu(hydraulic, bus_voltage=30.0), lambda: InMaster(archive, "fmpy", 1e-3, bus_voltage=30.0)):
        with pytest.raises(EmcasError, match="its supply is supply_pressure, not a bus: leave --bus-voltage out"):
            make()


def test_archive_flies_like_its_four_fmus(hydraulic: Path, tmp_path: Path, flight: Mapping[str, Array]) -> None:
    """The flow is a sum in another order."""
    archive = write_archive(tmp_path / "EMCAS.ssp", hydraulic)
    manoeuvre = replace(SHORT, duration=0.1)
    found = flown(InMaster(archive, "fmpy", 1e-3, "rocket"), manoeuvre)
    assert np.abs(fins(found, "fin{}_rad") - fins(flight, "fin{}_rad")[:, :100]).max() < 1e-12
    np.testing.assert_allclose(found["line_flow_m3_s"], flight["line_flow_m3_s"][:100], rtol=1e-9)


def test_contradictory_options_are_refused_before_anything_is_built(hydraulic: Path, tmp_path: Path) -> None:
    fly = Options(("gentle",), (IDEAL, "fmu"))
    refused(replace(fly, models=("electrohydralic",)), tmp_path, "there is no actuator 'electrohydralic'.*did you mean")
    refused(replace(fly, models=(HYDRAULIC, "elastic"), masters=("fmpy",)), tmp_path, "--host: flies one actuator")
    refused(replace(fly, models=(HYDRAULIC, "elastic"), actuators=("stiff",)), tmp_path, "stiff: flies one actuator")
    refused(replace(fly, fmu=hydraulic, models=(HYDRAULIC,)), tmp_path, f"--model {HYDRAULIC}: is flown already")
    refused(replace(fly, fmu=hydraulic, actuators=("second-order",)), tmp_path, "fitted to the nonlinear model, which")
    refused(replace(fly, fmu=hydraulic, mixing=True), tmp_path, "is a single actuator, without mixing")
    assert [path.name for path in tmp_path.iterdir()] == []


def test_every_kind_with_a_supply_is_flown() -> None:
    models = every_model()
    assert {"nonlinear", HYDRAULIC} <= set(models)
    assert "second-order" not in models  # has no supply


@pytest.mark.parametrize(("drawn", "unit_shown", "joules"), [(20.0, "J", 1.0), (2000.0, "kJ", 1e3)])
def test_energies_in_the_plots_are_those_of_the_table(flight: Mapping[str, Array], drawn: float, unit_shown: str,
                                                      joules: float) -> None:
    """The line ends at supplied less returned energy, and the bars show both, for a power of both signs."""
    power = flight["power_w"] - flight["power_w"].mean() / 2.0
    two_signs = {**flight, "power_w": power * drawn / (np.maximum(power, 0.0).sum() * 1e-3)}
    unit = Unit("EMCAS.fmu", "", "supply_pressure", 21e6, 0.0)
    results = Results(1e-3, {"gentle": {IDEAL: flown(Ideal()), HYDRAULIC: two_signs}}, MANOEUVRES,
                      units={HYDRAULIC: unit})
    found = figures(two_signs, 1e-3, {})
    assert found["energy_returned_j"] > 0.1
    with style():
        figure = kinds(results, "gentle").figure
    _, energy, _, share = figure.axes
    line: Any = energy.lines[0].get_ydata()
    assert joules * line[-1] == pytest.approx(found["energy_drawn_j"] - found["energy_returned_j"])
    widths = sorted(joules * bar.get_width() for bar in share.patches)  # type: ignore[attr-defined]
    assert widths == pytest.approx([-found["energy_returned_j"], found["energy_drawn_j"]])
    assert [f"[{unit_shown}]" in words for words in (energy.get_ylabel(), share.get_xlabel())] == [True, True]
    assert [label.get_text() for label in share.get_yticklabels()] == [f"{HYDRAULIC} (hydraulic)"]


def test_table_has_every_kind() -> None:
    """Its figures take minutes of flights and are not tested."""
    script("make_tables")
    maker = script("make_jsbsim")
    text = (ROOT / "examples/jsbsim/README.md").read_text(encoding="utf-8")
    table = text.split("<!-- kinds -->")[1].split("<!-- /kinds -->")[0]
    rows = re.findall(r"^\| `(.+?)` \|", table, re.MULTILINE)
    assert rows == ["second-order", *maker.models()], "run python docs/figures/make_jsbsim.py"


@pytest.mark.slow
def test_outputs_of_a_run_with_two_kinds_name_both(hydraulic: Path, tmp_path: Path) -> None:
    """One kind is an existing FMU, the other is built. Both keep the attitude in a gentle flight."""
    options = Options(("gentle",), (IDEAL, "second-order", "fmu", "stiff"), 4e-3, fmu=hydraulic, models=("nonlinear",),
                      bus_voltage=36.0, convergence=False)
    results = run(options, tmp_path, lambda what, share: None)
    assert list(results.flights["gentle"]) == [IDEAL, "second-order", HYDRAULIC, "nonlinear"]
    write_json(results, tmp_path / "figures.json", "test")
    figures = json.loads((tmp_path / "figures.json").read_text(encoding="utf-8"))
    assert all(kept(each) for each in figures["flights"]["gentle"].values())
    # The bus voltage is only for the actuator on a bus.
    assert figures["fmus"]["nonlinear"]["supply_start"] == 36.0
    assert figures["fmus"][HYDRAULIC]["supply"] == "supply_pressure"
    assert figures["flights"]["gentle"][HYDRAULIC]["line_flow_largest_l_min"] > 0.0
    write_report(results, tmp_path / "report.html", "test")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "JSBSim with EMCAS_electrohydraulic.fmu, EMCAS4.fmu" in page
    assert "on a pressure line of 21 MPa" in page
    assert page.count("<svg") == 4
    names = [path.name for path in write_flights(results, tmp_path, "npz")]
    assert f"gentle_{HYDRAULIC}.npz" in names


@pytest.mark.slow
def test_readme_has_the_figures_of_the_shipped_set(tmp_path: Path) -> None:
    """Within the printed digits, and 0.02 deg of attitude, which depends on single encoder counts."""
    results = run(Options(("aggressive",), (IDEAL, SECOND_ORDER, FMU), convergence=False), tmp_path, lambda *_: None)
    found = all_figures(results)["aggressive"]["nonlinear"]
    page = (ROOT / "examples/jsbsim/README.md").read_text(encoding="utf-8")
    row = re.search(r"\| aggressive: .*?\| EMCAS4\.fmu \| ([\d.]+)° \| ([\d.]+)° \| (\d+) N·m \| (\d+) % \| "
                    r"([\d.]+) kJ, peaks of ([\d.]+) kW", page, re.DOTALL)
    assert row
    printed = [float(text) for text in row.groups()]
    assert found["attitude_difference_to_ideal_deg"] == pytest.approx(printed[0], abs=0.05 + 0.02)
    assert found["attitude_difference_to_second_order_deg"] == pytest.approx(printed[1], abs=0.05 + 0.02)
    assert found["hinge_moment_largest_n_m"] == pytest.approx(printed[2], abs=0.5 + 0.1)
    assert found["saturated_percent"] == pytest.approx(printed[3], abs=0.5 + 0.1)
    assert 1e-3 * found["energy_drawn_j"] == pytest.approx(printed[4], abs=0.05)
    assert 1e-3 * found["power_largest_w"] == pytest.approx(printed[5], abs=0.05)


@pytest.mark.slow
def test_readme_has_the_figures_of_the_servo(tmp_path: Path) -> None:
    """Within the printed digits and a tenth, since the angle at which the gear sticks depends on rounding.

    In the aggressive manoeuvre the hinges are nearer to the centre of pressure.
    """
    page = (ROOT / "examples/jsbsim/README.md").read_text(encoding="utf-8")
    for manoeuvre, hinge in (("gentle", 0.41), ("aggressive", 0.46)):
        results = run(Options((manoeuvre,), (IDEAL, FMU), models=("servo",), convergence=False, hinge=hinge),
                      tmp_path, lambda *_: None)
        ideal, servo = (all_figures(results)[manoeuvre][name] for name in (IDEAL, "servo"))
        row = re.search(rf"\| {manoeuvre} \| {100.0 * hinge:g} % \| (\d+) N·m \| ([\d.]+)°, ([\d.]+)° \| (\d+)°/s \| "
                        r"([\d.]+)° \| kept, to ([\d.]+)° \|", page)
        assert row
        moment, rms, largest, rate, apart, end = (float(text) for text in row.groups())
        assert kept(servo)
        assert ideal["hinge_moment_largest_n_m"] == pytest.approx(moment, abs=0.5)
        assert servo["fin_error_rms_deg"] == pytest.approx(rms, abs=0.05 + 0.1 * rms)
        assert servo["fin_error_largest_deg"] == pytest.approx(largest, abs=0.05 + 0.1 * largest)
        assert servo["fin_rate_largest_deg_s"] == pytest.approx(rate, abs=0.5 + 0.1 * rate)
        assert servo["attitude_difference_to_ideal_deg"] == pytest.approx(apart, abs=0.05 + 0.1 * apart)
        assert servo["attitude_error_last_half_second_deg"] == pytest.approx(end, abs=0.05 + 0.1 * end)


def test_hinge_moment_is_proportional_to_the_distance_from_the_centre_of_pressure() -> None:
    """The flight with ideal fins is the same, since hinge moments do not affect them."""
    first, second = (flown(Ideal(), SHORT.hinged(hinge)) for hinge in (0.41, 0.46))
    assert apart(first, second) == 0.0
    assert 1.75 < first["mach"].min() < first["mach"].max() < 2.0
    centre = 0.472 + (first["mach"] - 1.75) / 0.25 * 0.005
    expected = fins(first, "hinge{}_n_m") * (centre - 0.46) / (centre - 0.41)
    # The difference amplifies rounding a hundredfold.
    np.testing.assert_allclose(fins(second, "hinge{}_n_m"), expected, rtol=1e-9)
    assert SHORT.hinged(SHORT.launch.hinge) is SHORT
