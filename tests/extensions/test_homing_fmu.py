"""Homing in both back ends, and as FMUs."""

from __future__ import annotations

import json
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from math import cos
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu

from emcas_fmu.extensions.status import HOMING, OPERATIONAL, UNREFERENCED
from emcas_fmu.fmi.package import build
from emcas_fmu.simulation import simulate

from ..fmu.host import OK, Fmu, Instance
from ..marks import slow
from .homing_run import BASE, MODEL, phases, run_of


@pytest.mark.parametrize("model", ["nonlinear+homing", *slow("elastic+homing")])
def test_kernels_are_one(model: str) -> None:
    python, compiled = (run_of({"fin.start_angle": 0.4}, 5.5, model, kernel=kernel, home=lambda t: t > 0.1,
                             fin_command=0.1, aero_torque=lambda t: 20.0 * cos(3.0 * t))
                        for kernel in ("python", "compiled"))
    assert phases(python) == [UNREFERENCED, HOMING, OPERATIONAL]
    for name, values in python.items():
        assert np.array_equal(values, compiled[name]), name


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    folder = tmp_path_factory.mktemp("homing")
    return {"python": build(BASE, folder / "python.fmu").path,
            "native": build(BASE, folder / "native.fmu", "native", cc="gcc").path}


@pytest.mark.slow
@pytest.mark.fmu
def test_fmus_home_by_their_input(built: Mapping[str, Path], tmp_path: Path) -> None:
    """Under fmpy in a fresh process, `home` as a signal; and a state kept amid the run continues bit for bit."""
    (tmp_path / "host.py").write_text(_HOST)
    found = {}
    for backend, unit in built.items():
        assert validate_fmu(str(unit)) == []
        done = subprocess.run([sys.executable, "host.py", unit], cwd=tmp_path, capture_output=True, text=True,
                              timeout=120)
        assert done.returncode == 0, done.stderr
        found[backend] = json.loads(done.stdout.splitlines()[-1])
    assert found["python"] == found["native"]
    same = simulate(BASE.values, 7.0, 0.01, model=MODEL, home=lambda t: t > 0.2 - 1e-9)
    for name in ("fin_angle", "measured_fin_angle", "status", "homed"):
        assert found["native"]["signal"][name] == same[name].tolist(), name
    assert found["native"]["continued"] == found["native"]["restored"]
    assert found["native"]["continued"][-1][2] == OPERATIONAL


_HOST = """
import json, sys
import numpy as np
from fmpy import extract, read_model_description, simulate_fmu
from fmpy.fmi2 import FMU2Slave
assert "emcas_fmu" not in sys.modules
path, names = sys.argv[1], ["fin_angle", "measured_fin_angle", "status", "homed"]
signal = np.array([(0.0, False), (0.2, False), (0.2, True), (8.0, True)], dtype=[("time", float), ("home", bool)])
run = simulate_fmu(path, stop_time=7.0, step_size=0.01, output_interval=0.01, input=signal, output=names)
description = read_model_description(path)
at = {v.name: v.valueReference for v in description.modelVariables}
slave = FMU2Slave(guid=description.guid, unzipDirectory=extract(path), instanceName="fin",
                  modelIdentifier=description.coSimulation.modelIdentifier)
slave.instantiate()
slave.setupExperiment(startTime=0.0)
slave.enterInitializationMode()
slave.exitInitializationMode()
slave.setBoolean([at["home"]], [True])
slave.setReal([at["fin_command"]], [0.1])
def move(begin, end):
    rows = []
    for k in range(begin, end):
        slave.doStep(k * 0.0103, 0.0103)
        rows.append(slave.getReal([at["fin_angle"], at["motor_current"]]) + slave.getInteger([at["status"]]))
    return rows
move(0, 200)
state = slave.getFMUstate()
kept = slave.serializeFMUstate(state)
first = move(200, 650)
slave.setFMUstate(slave.deSerializeFMUstate(kept))
print(json.dumps({"signal": {n: run[n].astype(float).tolist() for n in names}, "continued": first,
                  "restored": move(200, 650)}))
"""


@pytest.mark.slow
@pytest.mark.fmu
def test_four_fins_home_each_for_itself(tmp_path: Path) -> None:
    """On a stiff bus each is a single one."""
    path = build(BASE, tmp_path / "four.fmu", "native", cc="gcc", fins=4).path
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "four")
    unit = Instance(Fmu(str(tmp_path / "four")))
    starts, times = (0.3, -0.2, 0.0, 0.1), (0.1, 1.0, 9.0, 0.4)  # the third is not asked
    assert max(unit.initialize(**{f"fin[{k}].fin.start_angle": a for k, a in enumerate(starts, 1)})) == OK
    rows: list[list[float]] = [[] for _ in starts]
    for i in range(800):
        for k, asked in enumerate(times, 1):
            assert unit.set(f"fin[{k}].home", i * 0.01 > asked - 1e-9) == OK
        assert unit.step(i * 0.01, 0.01) == OK
        for k, row in enumerate(rows, 1):
            row.append(unit.get(f"fin[{k}].fin_angle"))
    ends = [unit.get_vr("Integer", [unit.fmu.references[f"fin[{k}].status"]])[1][0] for k in range(1, 5)]
    unit.free()
    assert ends == [OPERATIONAL, OPERATIONAL, UNREFERENCED, OPERATIONAL]
    for start, asked, row in zip(starts, times, rows, strict=True):
        signal = np.arange(801) * 0.01 > asked - 1e-9
        alone = simulate(BASE.with_values({"fin.start_angle": start}).values, 8.0, 0.01, model=MODEL, home=signal)
        assert row == alone["fin_angle"][1:].tolist()
