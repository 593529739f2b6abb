"""A single actuator fed by a pressure line."""

from __future__ import annotations

from math import sqrt
from pathlib import Path
from xml.etree.ElementTree import fromstring
from zipfile import ZipFile

import numpy as np
import pytest

from emcas_fmu.actuators.declaration import Supply
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.variables import boolean_input, real_input, real_output

MODEL = str(Path(__file__).with_name("throttled.py"))


def test_the_start_value_comes_from_the_file_in_any_unit(tmp_path: Path) -> None:
    (tmp_path / "low.toml").write_text('[hydraulic_supply]\npressure = "14 MPa"\n')
    for files, pressure in (([], 21e6), ([tmp_path / "low.toml"], 14e6)):
        given = load_parameters(files, model=MODEL)
        assert given.values["hydraulic_supply.pressure"] == pressure
        run = simulate(given.values, 0.05, model=MODEL, fin_command=0.5)
        flow = 1.7e-3 / 60.0 * sqrt(pressure / 7e6)  # the valve wide open
        # Rounding of a product and a root.
        assert run["supply_power"][10] == pytest.approx(pressure * flow, rel=1e-12)
        # The lag of 5 ms has gone to e^-10 of the rate.
        assert run["fin_rate"][-1] == pytest.approx(flow / 9.6e-6, rel=1e-4)


def test_both_kernels_agree_as_the_pressure_changes() -> None:
    pressure = 21e6 * np.random.default_rng(3).uniform(0.0, 1.3, 101)
    runs = [simulate(load_parameters(model=MODEL).values, 0.1, model=MODEL, kernel=kernel, supply_pressure=pressure,
                     fin_command=lambda t: 0.3 * np.sin(60.0 * t)) for kernel in ("python", "auto")]
    assert all(np.array_equal(runs[0][name], runs[1][name]) for name in runs[0])


def test_the_interface_has_the_pressure_with_its_unit(tmp_path: Path) -> None:
    built = build(load_parameters(model=MODEL), tmp_path / "one.fmu")
    with ZipFile(built.path) as archive:
        root = fromstring(archive.read("modelDescription.xml"))
    start = root.find("ModelVariables/ScalarVariable[@name='supply_pressure']/Real")
    assert start is not None
    given = start.attrib
    assert (float(given["start"]), given["unit"], given["declaredType"]) == (21e6, "Pa", "Pressure")
    base = root.find("UnitDefinitions/Unit[@name='Pa']/BaseUnit")
    assert base is not None
    assert base.attrib == {"kg": "1", "m": "-1", "s": "-2"}


def test_what_no_line_is_of() -> None:
    power = real_output("supply_power", "W", "", 1.0)
    for variable, said in ((real_input("supply_pressure", "bar", ""), r"supply_pressure \[bar\]: .* pressure \[Pa\]"),
                           (boolean_input("supply", "", True), r"supply \[\]: .* voltage \[V\]")):
        with pytest.raises(EmcasError, match=said):
            Supply(variable, power)
