"""Stribeck and LuGre friction in FMUs that a separate process runs."""

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
from tests.runs import assert_equal

pytestmark = pytest.mark.fmu
# A step to and fro under a load, with the second of two fins.
HOST = """
import json, sys
import fmpy
path, fin = sys.argv[1:]
folder = fmpy.extract(path)
description = fmpy.read_model_description(folder)
references = {v.name: v.valueReference for v in description.modelVariables}
instance = fmpy.instantiate_fmu(folder, description, "CoSimulation")
instance.setupExperiment(startTime=0.0)
instance.enterInitializationMode()
instance.exitInitializationMode()
rows = []
names = [v.name[len(fin):] for v in description.modelVariables
         if v.causality == "output" and v.name.startswith(fin) and v.type == "Real" and not v.name.startswith("bus.")]
for k in range(60):
    instance.setReal([references[fin + "fin_command"], references[fin + "aero_torque"]],
                     [0.01 if k < 30 else -0.01, -20.0])
    instance.doStep(k * 1e-3, 1e-3)
    rows.append(instance.getReal([references[fin + name] for name in names]))
instance.terminate()
print(json.dumps([names, rows]))
"""


@pytest.mark.slow
@pytest.mark.parametrize(("extension", "backend", "fins"), [
    ("stribeck", "python", 2), ("stribeck", "native", 1), ("lugre", "python", 1), ("lugre", "native", 2)])
def test_a_valid_fmu_computes_the_bits_of_this_process(extension: str, backend: str, fins: int, tmp_path: Path) -> None:
    model = f"nonlinear+{extension}"
    parameters = load_parameters(model=model)
    cc = "gcc" if backend == "native" else None
    if cc and shutil.which(cc) is None:
        pytest.skip("no gcc")
    path = build(parameters, tmp_path / "friction.fmu", backend, cc=cc, fins=fins).path
    assert validate_fmu(str(path)) == []
    done = subprocess.run([sys.executable, "-c", HOST, path, "" if fins == 1 else "fin[2]."], capture_output=True,
                          text=True, timeout=120, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    names, rows = json.loads(done.stdout.splitlines()[-1])
    times = np.arange(61) * 1e-3
    expected = simulate(parameters.values, 0.06, model=model, aero_torque=-20.0,
                        fin_command=np.where(times < 0.03 - 1e-9, 0.01, -0.01))
    assert ("friction_torque" in names) == (extension == "lugre")
    assert_equal(dict(zip(names, np.array(rows).T, strict=True)), {name: expected[name][1:] for name in names})
