"""The screw's efficiency in both kernels, in FMUs of both back ends, and in two fins."""

from __future__ import annotations

import subprocess
import sys
import zipfile
from math import sin
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu

from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import library
from emcas_fmu.simulation import simulate
from tests.runs import run_both_kernels

from ..fmu.built import both
from ..fmu.host import ERROR, Fmu, Instance
from ..marks import slow
from .runs import values_of

MODELS = ("nonlinear+efficiency", "elastic+efficiency")
_HOST = """
import fmpy, sys
names = sys.argv[2].split(",")
r = fmpy.simulate_fmu(sys.argv[1], stop_time=0.1, output_interval=1e-3, output=names,
                      start_values=dict(pair.split("=") for pair in sys.argv[3:]))
for name in names:
    print(" ".join(repr(float(x)) for x in r[name]))
"""


def _hosted(path: Path, names: list[str], *starts: str) -> np.ndarray:
    done = subprocess.run([sys.executable, "-c", _HOST, path, ",".join(names), *starts], capture_output=True, text=True,
                          check=True, timeout=120)
    return np.array([[float(x) for x in line.split()] for line in done.stdout.splitlines()])


@pytest.mark.parametrize("model", [MODELS[0], *slow(MODELS[1], "ristanovic+efficiency")])
def test_kernels_agree(model: str) -> None:
    if not library.available(model):
        pytest.skip("no C compiler")
    run_both_kernels(values_of({"friction.fin_coulomb": 3.0}, model=model), 0.15, model, acceleration__x=50.0,
                     fin_command=lambda t: 0.3 * sin(30.0 * t), aero_torque=lambda t: 100.0 * sin(70.0 * t),
                     enable=lambda t: not 0.05 < t < 0.08)


@pytest.fixture(scope="module", params=[MODELS[0], *slow(MODELS[1])])
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path, Path]:
    """Build a model's Python and native FMUs."""
    paths = both(load_parameters(model=request.param), tmp_path_factory.mktemp("efficiency"))
    return request.param, paths["python"], paths["native"]


@pytest.mark.slow
@pytest.mark.fmu
def test_back_ends_compute_the_same_bits(built: tuple[str, Path, Path]) -> None:
    model, *paths = built
    names = ["fin_angle", "motor_current", "supply_power", "screw_loss"]
    assert [validate_fmu(str(path)) for path in paths] == [[], []]
    python, native = (_hosted(path, names, "fin_command=0.2", "aero_torque=80", "efficiency.backward=0.5")
                      for path in paths)
    assert np.array_equal(python, native)
    expected = simulate(values_of({"efficiency.backward": 0.5}, model=model), 0.1, model=model, fin_command=0.2,
                        aero_torque=80.0)
    # Kernels of different compilers may differ by 1e-9 rad; powers are up to 1e3 W for each rad.
    assert np.abs(python - np.array([expected[name] for name in names])).max() < 1e-6
    units = {v.name: (v.unit, v.causality) for v in read_model_description(str(paths[0])).modelVariables}
    assert units["screw_loss"] == ("W", "output")


@pytest.mark.fmu
def test_an_fmu_refuses_a_backward_efficiency_that_jams(built: tuple[str, Path, Path], tmp_path: Path) -> None:
    model, python, native = built
    starts = {"efficiency.backward": -5.0, **({} if "elastic" in model else {"inertia.motor": 1e-6,
                                                                             "inertia.screw": 1e-6})}
    with zipfile.ZipFile(native) as archive:
        archive.extractall(tmp_path)
    instance = Instance(Fmu(str(tmp_path)))
    assert max(instance.initialize(**starts)) == ERROR
    assert "efficiency.backward = -5 must not be below" in instance.messages(ERROR)
    instance.free()
    # pythonfmu can only refuse the first step.
    assert np.isnan(_hosted(python, ["fin_angle"], *(f"{name}={value}" for name, value in starts.items()))[0, -1])


@pytest.mark.slow
@pytest.mark.fmu
def test_two_fins(tmp_path: Path) -> None:
    """Each has its own screw; on the bus the power that the second fin returns supplies the first."""
    path = build(load_parameters(model=MODELS[0]), tmp_path / "two.fmu", fins=2, references=False).path
    assert validate_fmu(str(path)) == []
    names = ["fin[1].screw_loss", "fin[2].screw_loss", "fin[2].supply_power", "supply_power", "fin[1].supply_power"]
    opposing, aiding, returned, bus, drawn = _hosted(
        path, names, "fin[1].fin_command=0.2", "fin[2].fin_command=0.2", "fin[1].aero_torque=-80",
        "fin[2].aero_torque=80", "fin[1].efficiency.forward=1", "fin[1].efficiency.backward=1")
    assert np.all(opposing == 0.0)
    assert aiding.max() > 10.0
    assert returned.min() < -100.0
    assert bus == pytest.approx(returned + drawn, rel=1e-9, abs=1e-6)
