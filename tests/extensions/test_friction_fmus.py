"""Stribeck and LuGre friction as FMUs: valid, and in a fresh process the numbers of this one."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu

from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate

pytestmark = pytest.mark.fmu
# A step and back under load, on the second of two fins where there are two.
HOST = """
import json, sys
import fmpy
path, fin = sys.argv[1:]
folder = fmpy.extract(path)
description = fmpy.read_model_description(folder)
found = {v.name: v.valueReference for v in description.modelVariables}
unit = fmpy.instantiate_fmu(folder, description, "CoSimulation")
unit.setupExperiment(startTime=0.0)
unit.enterInitializationMode()
unit.exitInitializationMode()
rows = []
names = [v.name[len(fin):] for v in description.modelVariables
         if v.causality == "output" and v.name.startswith(fin) and v.type == "Real" and not v.name.startswith("bus.")]
for k in range(60):
    unit.setReal([found[fin + "fin_command"], found[fin + "aero_torque"]], [0.01 if k < 30 else -0.01, -20.0])
    unit.doStep(k * 1e-3, 1e-3)
    rows.append(unit.getReal([found[fin + name] for name in names]))
unit.terminate()
print(json.dumps([names, rows]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("option", "backend", "fins"), [
    ("stribeck", "python", 2), ("stribeck", "native", 1), ("lugre", "python", 1), ("lugre", "native", 2)])
def test_fmu_is_valid_and_the_same_elsewhere(option: str, backend: str, fins: int, tmp_path: Path) -> None:
    model = f"nonlinear+{option}"
    parameters = load_parameters(model=model)
    cc = "gcc" if backend == "native" else None
    if cc and shutil.which(cc) is None:
        pytest.skip("no gcc")
    made = build(parameters, tmp_path / "unit.fmu", backend, cc=cc, fins=fins)
    assert validate_fmu(str(made.path)) == []
    done = subprocess.run([sys.executable, "-c", HOST, made.path, "" if fins == 1 else "fin[2]."], capture_output=True,
                          text=True, timeout=120, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    names, rows = json.loads(done.stdout.splitlines()[-1])
    times = np.arange(61) * 1e-3
    expected = simulate(parameters.values, 0.06, model=model, aero_torque=-20.0,
                        fin_command=np.where(times < 0.03 - 1e-9, 0.01, -0.01))
    assert ("friction_torque" in names) == (option == "lugre")
    for name, column in zip(names, np.array(rows).T, strict=True):
        assert np.array_equal(column, expected[name][1:]), name
