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
from tests.runs import assert_equal

MODEL = str(Path(__file__).with_name("throttled.py"))


def test_the_start_value_comes_from_the_file_in_any_unit(tmp_path: Path) -> None:
    (tmp_path / "low.toml").write_text('[hydraulic_supply]\npressure = "14 MPa"\n')
    for files, pressure in (([], 21e6), ([tmp_path / "low.toml"], 14e6)):
        values = load_parameters(files, model=MODEL).values
        assert values["hydraulic_supply.pressure"] == pressure
        run = simulate(values, 0.05, model=MODEL, fin_command=0.5)
        flow = 1.7e-3 / 60.0 * sqrt(pressure / 7e6)  # the valve wide open
        assert run["supply_power"][10] == pytest.approx(pressure * flow, rel=1e-12)  # rounding of product and root
        # The rate lags by 5 ms, which is e^-10 of it at the end.
        assert run["fin_rate"][-1] == pytest.approx(flow / 9.6e-6, rel=1e-4)


def test_kernels_agree_under_a_changing_pressure() -> None:
    pressure = 21e6 * np.random.default_rng(3).uniform(0.0, 1.3, 101)
    python, fast = (simulate(load_parameters(model=MODEL).values, 0.1, model=MODEL, kernel=kernel,
                             supply_pressure=pressure, fin_command=lambda t: 0.3 * np.sin(60.0 * t))
                    for kernel in ("python", "auto"))
    assert_equal(fast, python)


def test_the_fmu_describes_the_pressure_and_its_unit(tmp_path: Path) -> None:
    with ZipFile(build(load_parameters(model=MODEL), tmp_path / "one.fmu").path) as archive:
        root = fromstring(archive.read("modelDescription.xml"))
    pressure = root.find("ModelVariables/ScalarVariable[@name='supply_pressure']/Real")
    assert pressure is not None
    assert (float(pressure.attrib["start"]), pressure.attrib["unit"], pressure.attrib["declaredType"]) == (
        21e6, "Pa", "Pressure")
    base = root.find("UnitDefinitions/Unit[@name='Pa']/BaseUnit")
    assert base is not None
    assert base.attrib == {"kg": "1", "m": "-1", "s": "-2"}


def test_a_supply_of_another_unit_is_refused() -> None:
    power = real_output("supply_power", "W", "", 1.0)
    for variable, message in (
            (real_input("supply_pressure", "bar", ""), r"supply_pressure \[bar\]: .* pressure \[Pa\]"),
            (boolean_input("supply", "", True), r"supply \[\]: .* voltage \[V\]")):
        with pytest.raises(EmcasError, match=message):
            Supply(variable, power)
