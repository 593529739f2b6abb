"""The option in every form: both kernels, both back ends under fmpy in a fresh process, two fins."""

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

from ..fmu.built import both
from ..fmu.host import ERROR, Fmu, Instance
from ..marks import slow

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
def test_kernels_are_one(model: str) -> None:
    if not library.available(model):
        pytest.skip("no C compiler")
    values = load_parameters(model=model).with_values({"friction.fin_coulomb": 3.0}).values
    python, c = (simulate(values, 0.15, model=model, kernel=kernel, fin_command=lambda t: 0.3 * sin(30.0 * t),
                          aero_torque=lambda t: 100.0 * sin(70.0 * t), enable=lambda t: not 0.05 < t < 0.08,
                          acceleration__x=50.0) for kernel in ("python", "compiled"))
    for name in python:
        assert np.array_equal(python[name], c[name]), name


@pytest.fixture(scope="module", params=[MODELS[0], *slow(MODELS[1])])
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path, Path]:
    """A model and its FMUs, Python and native."""
    paths = both(load_parameters(model=request.param), tmp_path_factory.mktemp("efficiency"))
    return request.param, paths["python"], paths["native"]


@pytest.mark.slow
@pytest.mark.fmu
def test_back_ends_are_one(built: tuple[str, Path, Path]) -> None:
    model, *paths = built
    names = ["fin_angle", "motor_current", "supply_power", "screw_loss"]
    found = []
    for path in paths:
        assert validate_fmu(str(path)) == []
        found.append(_hosted(path, names, "fin_command=0.2", "aero_torque=80", "efficiency.backward=0.5"))
    assert np.array_equal(found[0], found[1])
    here = simulate(load_parameters(model=model).with_values({"efficiency.backward": 0.5}).values, 0.1, model=model,
                    fin_command=0.2, aero_torque=80.0)
    # 1e-9 is the contract between kernels built by other compilers, in rad; powers are up to 1e3 W a rad.
    assert np.abs(found[0] - np.array([here[name] for name in names])).max() < 1e-6
    units = {v.name: (v.unit, v.causality) for v in read_model_description(str(paths[0])).modelVariables}
    assert units["screw_loss"] == ("W", "output")


@pytest.mark.fmu
def test_combinations_are_refused(built: tuple[str, Path, Path], tmp_path: Path) -> None:
    model, python, native = built
    starts = {"efficiency.backward": -5.0, **({} if "elastic" in model else {"inertia.motor": 1e-6,
                                                                             "inertia.screw": 1e-6})}
    with zipfile.ZipFile(native) as archive:
        archive.extractall(tmp_path)
    instance = Instance(Fmu(str(tmp_path)))
    assert max(instance.initialize(**starts)) == ERROR
    assert "efficiency.backward = -5 must not be below" in instance.messages(ERROR)
    instance.free()
    # pythonfmu can but refuse the first step.
    assert np.isnan(_hosted(python, ["fin_angle"], *(f"{name}={value}" for name, value in starts.items()))[0, -1])


@pytest.mark.slow
@pytest.mark.fmu
def test_two_fins(tmp_path: Path) -> None:
    """Each with its own screw, on one bus that takes back what the second returns."""
    path = build(load_parameters(model=MODELS[0]), tmp_path / "two.fmu", fins=2, references=False).path
    assert validate_fmu(str(path)) == []
    names = ["fin[1].screw_loss", "fin[2].screw_loss", "fin[2].supply_power", "supply_power", "fin[1].supply_power"]
    found = _hosted(path, names, "fin[1].fin_command=0.2", "fin[2].fin_command=0.2", "fin[1].aero_torque=-80",
                    "fin[2].aero_torque=80", "fin[1].efficiency.forward=1", "fin[1].efficiency.backward=1")
    opposing, aiding, returned, bus, drawn = found
    assert np.all(opposing == 0.0)
    assert aiding.max() > 10.0
    assert returned.min() < -100.0
    assert bus == pytest.approx(returned + drawn, rel=1e-9, abs=1e-6)
