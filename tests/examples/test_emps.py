"""The example of the EMPS drive agrees with an independent integration, and with synthetic and published records.

Tests with the published records, in the folder that EMCAS_RECORDS names, are skipped without it.
"""

from __future__ import annotations

import json
import logging
import os
import re
from collections.abc import Callable, Mapping
from math import exp
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from scipy import io
from typer.testing import CliRunner, Result

from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from examples.emps.calibration import FREE, calibrated
from examples.emps.compare import BEGIN, compare
from examples.emps.records import FITTED, UNSEEN, VARIABLE, Array, Record, folder_of, load
from examples.emps.simulated import MODEL, Errors, friction_levels, in_windows, parameters, under_loops

FOLDER = Path(MODEL).parent
APP = typer.Typer()
APP.command()(compare)
COUNT = 2300  # samples


def run_program(*arguments: Any, **environment: str) -> Result:
    """Run the program without the caller's folder of records."""
    return CliRunner().invoke(APP, [*map(str, arguments)], env={VARIABLE: None, "COLUMNS": "200", **environment})


def integrated(p: Mapping[str, float], command: Array, added: Array) -> tuple[Array, Array]:
    """Return position and voltage of the equations at the head of emps.py, stepped by Heun's method in 0.01 ms."""
    x = v = f = before = previous = 0.0
    positions, voltages = np.empty((2, len(command)))

    def friction(x: float, v: float, f: float) -> float:
        side, at, speed = "positive" if v >= 0.0 else "negative", x - 0.123, abs(v)
        sliding = (p["friction.dry"] + p["friction.build_up"] * (1.0 - exp(-speed / p["friction.build_up_rate"]))
                   + p[f"friction.viscous_{side}"] * speed)
        place = 1.0 + p[f"friction.slope_{side}"] * at + p[f"friction.curvature_{side}"] * at * at
        return sliding * place + p[f"friction.load_{side}"] * abs(f)

    def acceleration(x: float, v: float, f: float, way: float) -> float:
        return (f - p["axis.offset"] - way * friction(x, v, f)) / p["inertia.fin"]

    def lagged(f: float, u: float, h: float) -> float:
        return 35.15065188 * u + (f - 35.15065188 * u) * exp(-h / p["drive.lag"])

    for k in range(len(command)):
        rate = (x - before) / 2e-3
        u = 243.45 * (160.18 * (command[k] - x) - rate) + added[k]
        before, previous = previous, x
        positions[k], voltages[k] = x, u
        left = 1e-3
        while left > 1e-12:
            driving, h = f - p["axis.offset"], min(left, 1e-5)
            way = np.sign(v) if v else np.sign(driving) * (abs(driving) > friction(x, 0.0, f))
            if way:
                a = acceleration(x, v, f, way)
                a = 0.5 * (a + acceleration(x + h * v, v + h * a, lagged(f, u, h), way))
                if v and v * (v + h * a) < 0.0:  # until it stops, where friction changes its sign
                    h = -v / a
                    x, v = x + 0.5 * h * v, 0.0
                else:
                    x, v = x + h * (v + 0.5 * h * a), v + h * a
            f, left = lagged(f, u, h), left - h
    return positions, voltages


@pytest.fixture(scope="module")
def synthetic() -> Record:
    """A record of a motion forwards and back with a pulse of 2 V, without noise."""
    time = np.arange(COUNT) * 1e-3
    command = 0.03 * (1.0 - np.cos(2.0 * np.pi * time / 1.1))
    added = np.where((time > 0.3) & (time < 0.5), 2.0, 0.0)
    position, voltage = integrated(parameters(), command, added)
    return Record("synthetic", command, position, voltage, added, "")


def save(folder: Path, record: Record, **changes: Any) -> Path:
    """Write both files of records to the folder and return it."""
    content = {"t": np.arange(len(record)) * 1e-3, "qg": record.command, "qm": record.position, "vir": record.voltage}
    io.savemat(folder / FITTED, {k: v for k, v in (content | changes).items() if v is not None})
    io.savemat(folder / UNSEEN, {**content, "pulses_N": record.added})
    return folder


def test_equations_and_loops_agree_with_an_independent_integration(synthetic: Record) -> None:
    # In V, without the first 50 samples, whose start speed comes from a filter. Measured at reversals: 3.5e-4 with the
    # example's ticks (the error is of second order in them), and 5e-5, which is the error of the integration.
    for tick, most in ((2.5e-4, 7e-4), (2.5e-5, 1e-4)):
        _, voltage = under_loops(synthetic, [{**parameters(), "solver.max_tick": tick}])
        assert np.abs(voltage[0] - synthetic.voltage)[50:].max() < most
    assert np.abs(synthetic.voltage).max() > 1.0


def test_windows_begin_in_the_state_of_the_record(synthetic: Record) -> None:
    errors = in_windows(synthetic, [parameters()])[0]
    # Measured 1.5 um, because the start speed comes from a filter of the position.
    assert np.abs(errors).max() < 3e-6
    assert (np.abs(in_windows(synthetic, [parameters()], 1.0)[0]).max(axis=1) > 1e-3).all()  # 1 N is detected


def test_level_of_friction_is_estimated_from_the_previous_windows(synthetic: Record) -> None:
    level = friction_levels(synthetic, {**parameters(), "friction.dry": parameters()["friction.dry"] - 0.5})
    # The parameters have 0.5 N less than the record; the errors are linear within 0.5 %.
    assert level == pytest.approx([0.0, 0.5], rel=0.01)


def test_calibration_recovers_the_parameters(synthetic: Record) -> None:
    true = parameters()
    free = {name: FREE[name] for name in ("inertia.fin", "friction.dry", "friction.viscous_negative", "drive.lag")}
    again = calibrated(synthetic, {**true, **{name: 1.2 * true[name] for name in free}}, free)
    # Measured 2e-5: difference of the two integrations, and the windows' start speeds. The search begins 20 % off.
    assert {name: again[name] for name in free} == pytest.approx({name: true[name] for name in free}, rel=1e-4)


def test_program_writes_figures_and_plot(synthetic: Record, tmp_path: Path) -> None:
    result = run_program("--records", save(tmp_path, synthetic), "--json", tmp_path / "new.json", "--plot",
                         tmp_path / "new.svg")
    assert result.exit_code == 2, "results must not be written to the folder of records"
    result = run_program("--records", tmp_path, "--plot", tmp_path.parent / "new.html")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1), result.output
    (tmp_path / "emps").mkdir()
    save(tmp_path / "emps", synthetic)
    result = run_program("--json", tmp_path / "new.json", "--plot", tmp_path / "new.svg", **{VARIABLE: str(tmp_path)})
    assert result.exit_code == 0, result.output
    figures = json.loads((tmp_path / "new.json").read_text("utf-8"))
    assert figures["unseen"]["force_percent"] < 0.01 < 1.0 < figures["authors"]["symmetrical"]["unseen"][
        "force_percent"]
    assert set(figures["unseen"]) == set(Errors.__annotations__)
    assert (tmp_path / "new.svg").stat().st_size > 10_000


@pytest.mark.parametrize(("change", "words"), [
    ({"vir": None}, "there is no vir"), ({"qm": np.zeros(5)}, "position 5"), ({"t": np.arange(COUNT) * 2e-3}, "1 ms"),
    ({"qg": np.full(COUNT, np.nan)}, "not finite")])
def test_error_names_a_bad_record(synthetic: Record, tmp_path: Path, change: Mapping[str, Any], words: str) -> None:
    result = run_program("--records", save(tmp_path, synthetic, **change))
    assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (2, "", 1)
    assert FITTED in result.stderr
    assert words in result.stderr


def test_error_without_records(tmp_path: Path) -> None:
    for result in run_program(), run_program("--records", tmp_path):
        assert (result.exit_code, result.stdout, result.stderr.count("\n")) == (3, "", 1)
        assert "nonlinearbenchmark" in result.stderr
    for name in (FITTED, UNSEEN):
        (tmp_path / name).write_text("no numbers", encoding="utf-8")
    result = run_program("--records", tmp_path)
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)


def test_simulation_gives_no_warning(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    response = simulate(parameters(), 2.0, model=MODEL, fin_command=0.1)
    assert caplog.messages == []
    # The axis sticks where the controllers' force is below the dry friction: 6.8 um, with k_p and k_v.
    assert response["fin_angle"][-1] == pytest.approx(0.1, abs=8e-6)


# -- the published records ---------------------------------------------------------------


@pytest.fixture(scope="module")
def published() -> Callable[[str], Record]:
    """Function that loads a record by its name."""
    folder = os.environ.get(VARIABLE)
    if not folder:
        pytest.skip(f"no records of the EMPS drive: {VARIABLE} names no folder")
    return lambda name: load(folder_of(Path(folder)) / name)


def test_controllers_agree_with_those_of_the_rig(published: Callable[[str], Record]) -> None:
    record, p = published(FITTED), parameters()
    rate = (record.position[2:] - record.position[:-2]) / 2e-3
    law = p["controller.kv"] * (p["controller.kp"] * (record.command - record.position)[2:] - rate)
    assert np.std(law - record.voltage[2:]) < 4e-3  # 3.7 mV; an encoder's count in the speed is 6 mV


def test_readme_has_the_errors_of_the_records(published: Callable[[str], Record], tmp_path: Path) -> None:
    result = run_program("--json", tmp_path / "new.json", **{VARIABLE: os.environ[VARIABLE]})
    assert result.exit_code == 0, result.output
    figures = json.loads((tmp_path / "new.json").read_text("utf-8"))
    assert figures["unseen"]["force_percent"] <= 4.0
    assert figures["unseen"]["window_rms_mm"] <= 1.4
    page = (FOLDER / "README.md").read_text("utf-8")
    for words, of in (("authors, symmetrical", figures["authors"]["symmetrical"]), ("this model", figures),
                      ("authors, asymmetrical", figures["authors"]["asymmetrical"])):
        for record in ("fitted", "unseen"):
            (row,) = re.findall(rf"^\| {words} \| {record} \|(.*)\|$", page, re.MULTILINE)
            shown = [cell.strip() for cell in row.split("|")]
            assert shown == [f"{of[record][key]:.{digits}f}" for key, digits in (
                ("force_percent", 2), ("position_percent", 5), ("window_rms_mm", 2), ("window_rms_mm_level", 2))]


@pytest.mark.slow
def test_calibration_gives_the_shipped_parameters(published: Callable[[str], Record]) -> None:
    shipped = parameters()
    again = calibrated(published(FITTED), {**shipped, **BEGIN})
    # Stored with five digits; the search ends within 1e-5 of the scales.
    assert {name: again[name] for name in FREE} == pytest.approx({name: shipped[name] for name in FREE}, rel=1e-3)
    assert {e.source for e in load_parameters(model=MODEL).entries if e.variable.name in FREE} == {"identified"}
