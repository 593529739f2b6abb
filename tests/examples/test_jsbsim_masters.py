"""The flight with four EMCAS.fmu in an SSP, in fmpy, libcosim and Ecos."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.errors import EmcasError
from examples.jsbsim.fmu import Fmu
from examples.jsbsim.masters import VARIANT, InMaster, agreement
from examples.jsbsim.run import Options, run
from examples.jsbsim.vehicle import Array
from tests.hosts.host import missing, trajectory

from .conftest import Doctor
from .flying import ABSENT, SHORT, apart, flown

STRUCTURE = f"{VARIANT}.ssd"
# Times of the masters differ by 1e-15 s, and no output changes faster than 1e6 per second.
SAME = 1e-9


@pytest.fixture(scope="module")
def expected(ssp: Path) -> Mapping[str, Array]:
    """The flight in fmpy."""
    return flown(InMaster(ssp, "fmpy", 1e-3, VARIANT))


@pytest.mark.slow
@pytest.mark.fmu
@pytest.mark.parametrize("master", ["libcosim", "ecos"])
def test_same_flight_as_in_fmpy(master: str, ssp: Path, expected: Mapping[str, Array]) -> None:
    """The master runs in a separate process. A delay of one step would be 1e-3 rad or more."""
    script = Path(__file__).with_name("flying.py")
    process = subprocess.run([sys.executable, script, ssp, master], capture_output=True, text=True, timeout=60)
    if process.returncode == ABSENT:
        missing(f"{master} cannot be loaded: {process.stderr.strip()}")
    assert process.returncode == 0, process.stderr[-4000:]
    flight = {name: np.array(values) for name, values in trajectory(process.stdout).items()}
    assert flight.keys() == expected.keys()
    found = agreement(flight, expected)
    assert found.fins < SAME
    assert found.attitude < SAME
    assert np.abs(np.diff(expected["fin1_rad"])).max() > 1e-3


def test_archive_flies_like_the_fmu_of_four_fins(ssp: Path, four: Path, expected: Mapping[str, Array]) -> None:
    """EMCAS4.fmu has a stiff bus. The archive without its variant lacks gravity."""
    assert apart(expected, flown(Fmu(four))) < 1e-12
    assert apart(expected, flown(InMaster(ssp, "fmpy", 1e-3))) > 1e-9


def test_agreement_of_flights() -> None:
    flight = {f"{n}_rad": np.zeros(3) for n in ("fin1", "fin2", "fin3", "fin4", "roll", "pitch", "yaw")}
    other = {**flight, "fin4_rad": np.array([0.0, -0.2, 0.1]), "yaw_rad": np.array([0.0, 0.0, 0.3])}
    same, differs = agreement(flight, flight), agreement(other, flight)
    assert (same.fins, same.attitude, same.identical) == (0.0, 0.0, True)
    assert (differs.fins, differs.attitude, differs.identical) == (0.2, 0.3, False)


@pytest.mark.parametrize(("old", "new", "message"), [
    ('name="fin_angle"', 'name="angle"', "fin1.fin_angle -> rocket: the system has no output fin1.fin_angle"),
    ('name="aero_torque"', 'name="load"', "rocket -> fin1.aero_torque: the system has no input fin1.aero_torque"),
    ('unit="rad/s"', 'unit="deg/s"', "rocket -> fin1.angular_rate.x: fin1.angular_rate.x is in deg/s, not rad/s"),
])
def test_wiring_errors_name_the_connection(old: str, new: str, message: str, ssp: Path, doctored: Doctor) -> None:
    with pytest.raises(EmcasError, match=re.escape(f"connection {message}")):
        InMaster(doctored(ssp, STRUCTURE, old, new), "fmpy", 1e-3, VARIANT)


def test_unknown_master_or_variant_is_refused(ssp: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(EmcasError, match="there is no master 'libcosimpy'; there is fmpy, libcosim, ecos"):
        InMaster(ssp, "libcosimpy", 1e-3)
    with pytest.raises(EmcasError, match="has no variant 'cold'; it has nominal, rocket"):
        InMaster(ssp, "fmpy", 1e-3, "cold")
    monkeypatch.setitem(sys.modules, "libcosimpy", None)
    with pytest.raises(EmcasError, match="libcosimpy cannot be loaded"):
        InMaster(ssp, "libcosim", 1e-3)


def test_another_step_than_that_of_the_master_is_refused(ssp: Path) -> None:
    with pytest.raises(EmcasError, match=r"was opened with steps of 0\.002 s, not 0\.001 s"):
        flown(InMaster(ssp, "fmpy", 2e-3, VARIANT), SHORT, 1e-3)


def test_contradictory_options_are_refused(ssp: Path, four: Path, tmp_path: Path) -> None:
    def refused(options: Options, message: str) -> None:
        with pytest.raises(EmcasError, match=message):
            run(options, tmp_path, lambda what, share: None)

    ideal = Options(("gentle",), ("ideal",))
    refused(Options(("gentle",), ("ideal",), ssp=ssp), "--ssp .* is flown in another master only: pass --host, too")
    refused(Options(("gentle",), ("ideal",), variant="cold"), "--variant cold: is a variant of an archive: pass --ssp")
    refused(Options(("gentle",), ("stiff",), fmu=four, masters=("fmpy",)),
            "has four actuators, and an archive needs single ones: pass --ssp FILE")
    assert run(Options(ideal.manoeuvres, ideal.actuators, 4e-3, convergence=False), tmp_path,
               lambda what, share: None).masters == {}
