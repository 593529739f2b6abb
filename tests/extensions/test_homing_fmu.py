"""Homing in both kernels and as FMUs."""

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
from tests.runs import run_both_kernels

from ..fmu.host import OK, Fmu, Instance
from ..marks import slow
from .homing_run import BASE, MODEL, phases
from .runs import values_of


@pytest.mark.parametrize("model", ["nonlinear+homing", *slow("elastic+homing")])
def test_kernels_agree(model: str) -> None:
    run = run_both_kernels(values_of(model=model, fin__start_angle=0.4), 5.5, model, home=lambda t: t > 0.1,
                           fin_command=0.1, aero_torque=lambda t: 20.0 * cos(3.0 * t))
    assert phases(run) == [UNREFERENCED, HOMING, OPERATIONAL]


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Path]:
    folder = tmp_path_factory.mktemp("homing")
    return {"python": build(BASE, folder / "python.fmu").path,
            "native": build(BASE, folder / "native.fmu", "native", cc="gcc").path}


@pytest.mark.slow
@pytest.mark.fmu
def test_fmus_home_by_their_input(built: Mapping[str, Path], tmp_path: Path) -> None:
    """fmpy runs them in a fresh process with `home` as a signal; a state saved during homing restores bit for bit."""
    results = {}
    for backend, path in built.items():
        assert validate_fmu(str(path)) == []
        done = subprocess.run([sys.executable, "-c", _HOST, path], cwd=tmp_path, capture_output=True, text=True,
                              timeout=120)
        assert done.returncode == 0, done.stderr
        results[backend] = json.loads(done.stdout.splitlines()[-1])
    assert results["python"] == results["native"]
    expected = simulate(BASE.values, 7.0, 0.01, model=MODEL, home=lambda t: t > 0.2 - 1e-9)
    for name in ("fin_angle", "measured_fin_angle", "status", "homed"):
        assert results["native"]["signal"][name] == expected[name].tolist(), name
    assert results["native"]["continued"] == results["native"]["restored"]
    assert results["native"]["continued"][-1][2] == OPERATIONAL


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
def test_each_of_four_fins_homes_as_a_single_one(tmp_path: Path) -> None:
    """On a stiff bus, bit for bit."""
    path = build(BASE, tmp_path / "four.fmu", "native", cc="gcc", fins=4).path
    assert validate_fmu(str(path)) == []
    with zipfile.ZipFile(path) as archive:
        archive.extractall(tmp_path / "four")
    instance = Instance(Fmu(str(tmp_path / "four")))
    starts, times = (0.3, -0.2, 0.0, 0.1), (0.1, 1.0, 9.0, 0.4)  # the third does not home within the run of 8 s
    assert max(instance.initialize(**{f"fin[{k}].fin.start_angle": a for k, a in enumerate(starts, 1)})) == OK
    rows: list[list[float]] = [[] for _ in starts]
    for i in range(800):
        for k, begin in enumerate(times, 1):
            assert instance.set(f"fin[{k}].home", i * 0.01 > begin - 1e-9) == OK
        assert instance.step(i * 0.01, 0.01) == OK
        for k, row in enumerate(rows, 1):
            row.append(instance.get(f"fin[{k}].fin_angle"))
    ends = [instance.get_vr("Integer", [instance.fmu.references[f"fin[{k}].status"]])[1][0] for k in range(1, 5)]
    instance.free()
    assert ends == [OPERATIONAL, OPERATIONAL, UNREFERENCED, OPERATIONAL]
    for start, begin, row in zip(starts, times, rows, strict=True):
        signal = np.arange(801) * 0.01 > begin - 1e-9
        alone = simulate(BASE.with_values({"fin.start_angle": start}).values, 8.0, 0.01, model=MODEL, home=signal)
        assert row == alone["fin_angle"][1:].tolist()
