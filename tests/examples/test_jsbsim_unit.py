"""EMCAS4.fmu in flight: agreement with four single FMUs, bus, mixing, and errors."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime.compiler import CompilerError, local_compilers, local_platform
from examples.jsbsim import build as building
from examples.jsbsim.actuators import LIMIT
from examples.jsbsim.flight import Turn
from examples.jsbsim.fmu import WIRED, Fmu
from examples.jsbsim.masters import VARIANT, InMaster, write_archive
from examples.jsbsim.results import fins
from tests.hosts.host import missing
from tests.marks import slow

from .conftest import Doctor
from .flying import SHORT, apart, flown

RESISTANCE = 0.02  # Ohm
SUPPLY_VOLTAGE = load_parameters().values["drive.supply_voltage"]
DESCRIPTION = "modelDescription.xml"


def test_fmu_of_four_fins_flies_like_four_fmus(native: Path, four: Path) -> None:
    """1e-12 rad is the documented accuracy on a stiff bus."""
    together, single = flown(Fmu(four)), flown(Fmu(native))
    assert apart(together, single) < 1e-12
    assert np.ptp(fins(together, "fin{}_rad")) > 0.2
    assert np.all(together["bus_voltage_v"] == SUPPLY_VOLTAGE)
    # Sums and divisions have another order: rounding of up to 8 kW.
    np.testing.assert_allclose(together["power_w"], single["power_w"], rtol=0, atol=1e-9)
    np.testing.assert_allclose(together["bus_current_a"], single["bus_current_a"], rtol=0, atol=1e-9)


@pytest.mark.slow
def test_supply_voltage_is_that_of_the_fmu_or_the_option(tmp_path: Path) -> None:
    """For an FMU of four fins, four FMUs of one fin, and an SSP."""
    local = local_platform()
    assert local is not None
    parameters = load_parameters().with_values({"drive.supply_voltage": 28.0})
    single, whole = (build(parameters, tmp_path / f"{n}.fmu", "native", [local.name], fins=n).path for n in (1, 4))
    archive = write_archive(tmp_path / "EMCAS.ssp", single)
    manoeuvre = replace(SHORT, duration=0.2)
    flights = {}
    for option, expected in ((None, 28.0), (24.0, 24.0)):
        actuators = (Fmu(whole, bus_voltage=option), Fmu(single, bus_voltage=option),
                     InMaster(archive, "fmpy", 1e-3, VARIANT, option))
        flights[expected] = [flown(each, manoeuvre) for each in actuators]
        for flight in flights[expected]:
            assert np.all(flight["bus_voltage_v"] == expected)
            assert apart(flight, flights[expected][0]) < 1e-12
    assert apart(flights[28.0][0], flights[24.0][0]) > 1e-3  # the effect of 4 V


@pytest.mark.parametrize("voltage", [0.0, -1.0, float("nan")])
def test_impossible_supply_is_refused(voltage: float, four: Path, ssp: Path) -> None:
    for make in (lambda: Fmu(four, bus_voltage=voltage), lambda: InMaster(ssp, "fmpy", 1e-3, VARIANT, voltage)):
        with pytest.raises(EmcasError, match=r"a bus voltage of .* must be above 0; pass another by --bus-voltage"):
            make()


def test_bus_voltage_sags_by_source_resistance_times_current(four: Path) -> None:
    """V = V_s - R I in every row; the communication step is that of the bus, 0.1 ms.

    The sag is computed from the previous current and differs from R I by at most the change in a step, plus 15 % of the
    previous change: one step of Newton's method leaves 1.3 %, and I = P / V 12 % at 200 A and 35 V.
    """
    flight = flown(Fmu(four, bus_resistance=RESISTANCE), replace(SHORT, duration=0.3), 1e-4)
    voltage, current = flight["bus_voltage_v"], flight["bus_current_a"]
    changed = np.abs(np.diff(current, prepend=0.0))
    allowed = RESISTANCE * (changed + 0.15 * np.concatenate([[0.0], changed[:-1]])) + 1e-9
    assert np.all(np.abs(voltage - (SUPPLY_VOLTAGE - RESISTANCE * current)) <= allowed)
    # The bound is narrow: no sag, or 1.5 times the sag, is outside it in most rows.
    assert np.mean(np.abs(voltage - SUPPLY_VOLTAGE) > allowed) > 0.5
    assert np.mean(np.abs(voltage - (SUPPLY_VOLTAGE - 1.5 * RESISTANCE * current)) > allowed) > 0.5
    np.testing.assert_allclose(flight["power_w"], voltage * current, rtol=0, atol=1e-9)  # rounding of 8 kW


def test_sag_changes_the_fin_angles(four: Path) -> None:
    """With 0.1 Ohm the voltage sags by a quarter, and fin angles differ by 0.06 deg or more."""
    stiff, soft = flown(Fmu(four)), flown(Fmu(four, bus_resistance=0.1))
    assert soft["bus_voltage_v"].min() < 0.75 * SUPPLY_VOLTAGE
    assert soft["bus_voltage_v"].max() > SUPPLY_VOLTAGE  # braking motors regenerate
    assert apart(stiff, soft) > 1e-3


def test_mixing_in_the_fmu_equals_the_mixing_of_the_example(four: Path) -> None:
    """The commands also reach their limit. The encoder is off, since rounding could change a count.

    1e-12 rad is then a few hundred times the rounding.
    """
    parameters = {**WIRED, "encoder.enabled": False}
    manoeuvre = replace(SHORT, turns=(Turn(0.02, (120.0, 25.0, -20.0)),))
    by_example, by_fmu = (flown(Fmu(four, parameters=parameters, mixing=mixing), manoeuvre) for mixing in (False, True))
    assert apart(by_example, by_fmu) < 1e-12
    assert np.mean(np.abs(fins(by_example, "command{}_rad")) == LIMIT) > 0.01


@pytest.mark.parametrize(("fins_built", "message"), [
    *slow((3, "connection autopilot -> fin[4].fin_command: has no variable fin[4].fin_command; one of `emcas build")),
    (5, "has 5 fins, and the rocket 4: one of `emcas build --fins 4` is needed")])
def test_another_number_of_fins_is_refused(fins_built: int, message: str, tmp_path: Path) -> None:
    path = build(load_parameters(), tmp_path / "other.fmu", fins=fins_built, references=False).path
    with pytest.raises(EmcasError, match=re.escape(message)):
        Fmu(path)


@pytest.mark.parametrize(("old", "new", "message"), [
    ('name="fin[3].aero_torque"', 'name="fin[3].torque"', "rocket -> fin[3].aero_torque: has no variable fin[3].aero_"),
    ('name="attitude.roll"', 'name="attitude.bank"', "rocket -> attitude.roll: has no variable attitude.roll"),
    ('name="bus_voltage"', 'name="voltage"', "bus_voltage -> figures: has no variable bus_voltage; one of"),
    ('unit="Ohm"', 'unit="V"', "bus.source_resistance is Real in V, not Real in Ohm; one of `emcas build --fins 4`"),
])
def test_wiring_errors_name_the_connection(old: str, new: str, message: str, four: Path, doctored: Doctor) -> None:
    with pytest.raises(EmcasError, match=re.escape(message)):
        Fmu(doctored(four, DESCRIPTION, old, new))


def test_another_guid_is_refused(four: Path, native: Path) -> None:
    with pytest.raises(EmcasError, match=r"EMCAS4.fmu: has GUID \{.*\}, not 1234"):
        Fmu(four, "1234")


@pytest.mark.parametrize("resistance", [-0.1, 2.0, float("nan")])
def test_impossible_bus_is_refused(resistance: float, four: Path) -> None:
    with pytest.raises(EmcasError, match=r"a bus resistance of .* must be 0 to 1"):
        Fmu(four, bus_resistance=resistance)


def test_bus_and_mixing_of_a_single_actuator_are_refused(native: Path) -> None:
    with pytest.raises(EmcasError, match=r"is a single actuator, without a shared bus: .* leave --bus-resistance"):
        Fmu(native, bus_resistance=RESISTANCE)
    with pytest.raises(EmcasError, match=r"is a single actuator, without mixing: .* leave --mixing"):
        Fmu(native, mixing=True)


def test_error_without_a_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(building, "zig", lambda: None)
    monkeypatch.setattr(building, "local_compilers", lambda: iter(()))
    with pytest.raises(CompilerError, match=r"without --fmu an FMU is built, which needs a C compiler: pip install"):
        building.build_unit(tmp_path, 4)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_fmu_is_built_with_a_system_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, native: Path) -> None:
    systems = [compiler for compiler in local_compilers() if not compiler.zig]
    if not systems:
        missing("there is no system compiler (Debian: apt-get install gcc)")
    monkeypatch.setattr(building, "zig", lambda: None)
    monkeypatch.setattr(building, "local_compilers", lambda: iter(systems))
    path = building.build_unit(tmp_path, 1)
    manoeuvre = replace(SHORT, duration=0.1)
    assert apart(flown(Fmu(path), manoeuvre), flown(Fmu(native), manoeuvre)) == 0.0
