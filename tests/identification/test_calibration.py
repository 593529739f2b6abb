"""Calibration identifies random actuators of every kind; the errors are as large as the stated sigmas."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from hashlib import sha256
from math import radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu import api
from emcas_fmu.bench.writers import write_json
from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.units import display
from emcas_fmu.parameters import ParameterSet, load_parameters
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.identification import calibration, estimation, replay
from emcas_fmu.studies.identification.unknowns import free_parameters
from emcas_fmu.units import factor
from tests.commands import emcas

from ..docs.recipes import run_block

STEP, ROWS = 1e-3, 600
# Free parameters of each kind, and outputs whose records determine them.
KINDS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "nonlinear": (("inertia.motor", "friction.viscous.positive", "drive.current_gain", "drive.transport_delay"),
                  ("fin_angle", "motor_current")),
    "linear": (("inertia.motor", "drive.current_gain"), ("fin_angle", "motor_current")),
    "second-order": (("second_order.natural_frequency", "second_order.damping"), ("fin_angle",)),
    "ristanovic": (("inertia.motor", "pwm.gain"), ("fin_angle", "motor_current")),
    "elastic": (("inertia.motor", "drive.current_gain"), ("fin_angle", "motor_current")),
    "habibi": (("inertia.motor", "drive.current_gain"), ("fin_angle", "motor_current")),
    "ozkan": (("inertia.motor", "drive.current_gain"), ("fin_angle", "motor_current")),
    "worm-gear": (("worm.friction", "drive.current_gain"), ("fin_angle", "motor_current")),
    "worm-gear-elastic": (("worm.friction", "drive.current_gain"), ("fin_angle", "motor_current")),
    "clutch": (("clutch.rated_torque", "inertia.fin"), ("fin_angle",)),
    "series-clutch": (("inertia.motor", "drive.current_gain"), ("fin_angle", "motor_current")),
    "servo": (("inertia.motor", "motor.no_load_speed"), ("fin_angle", "motor_current")),
    "electrohydrostatic": (("drive.current_gain", "inertia.motor"), ("fin_angle", "motor_current")),
    "electrohydraulic": (("valve.rated_flow", "valve.natural_frequency"), ("fin_angle",)),
    "nonlinear+stribeck": (("inertia.motor", "drive.current_gain"), ("fin_angle", "motor_current")),
    "nonlinear+heat": (("motor.resistance", "drive.current_gain"), ("motor_current", "motor_voltage")),
    "elastic+supply": (("inertia.motor", "drive.current_gain"), ("fin_angle", "motor_current")),
}
NOISE = 3e-3  # relative to an output's standard deviation; larger than its quantisation


def write(path: Path, columns: Mapping[str, tuple[Any, str]]) -> Path:
    """Write columns with their units to a file and return its path."""
    np.savetxt(path, np.array([values for values, _ in columns.values()]).T, delimiter=",", fmt="%.9g", comments="",
               header=",".join(f"{name} [{unit}]" for name, (_, unit) in columns.items()))
    return path


def records(truth: ParameterSet, outputs: Sequence[str], folder: Path, rng: np.random.Generator,
            count: int = 2) -> list[Path]:
    """Write records of square waves and sweeps with white noise, in the outputs' display units."""
    variables = {v.name: v for v in truth.actuator.outputs}
    time, paths = np.arange(ROWS) * STEP, []
    for k in range(count):
        phase = 2.0 * np.pi * (2.0 * time + 8.0 * time**2) if k % 2 else 2.0 * np.pi * 4.0 * time
        command = radians(4.0 + 2.0 * k) * (np.sin(phase) if k % 2 else np.sign(np.sin(phase + 0.3)))
        response = simulate(truth.values, time[-1], STEP, model=truth.model, fin_command=command)
        columns: dict[str, tuple[Any, str]] = {"time": (time, "s"), "fin_command": (np.degrees(command), "deg")}
        for name in outputs:
            v = variables[name]
            unit = display(v) or v.unit
            noisy = response[name] + rng.normal(0.0, NOISE * np.std(response[name]), ROWS)
            columns[name] = noisy * factor(v.unit, unit), unit
        paths.append(write(folder / f"{k}.csv", columns))
    return paths


def random_truth(base: ParameterSet, free: Sequence[str], rng: np.random.Generator) -> ParameterSet:
    """Return the base set with free parameters changed by up to 30 %."""
    return base.with_values({name: float(base.values[name]) * rng.uniform(0.75, 1.3) for name in free})


def errors(kind: str, seed: int, folder: Path, every: bool = False) -> list[float]:
    """Return the errors of a random actuator's estimates in stated sigmas, from the outputs of KINDS or from `every`.

    The list is empty if every output is compared and a problem is reported.
    """
    free, outputs = KINDS[kind]
    rng, base = np.random.default_rng(seed), load_parameters(model=kind)
    truth = random_truth(base, free, rng)
    if every:
        outputs = tuple(v.name for v in base.actuator.outputs if v.kind == "Real")
    result = calibration.calibrate(records(truth, outputs, folder, rng), base, free)
    if every and result.problems:  # reported: another minimum, or not settled
        return []
    return [(e.value - float(truth.values[e.name])) / e.sigma for e in result.estimates if e.parameter]


@pytest.mark.parametrize("kind", ["nonlinear", "linear", "second-order"])
def test_random_actuator_is_identified(kind: str, tmp_path: Path) -> None:
    z = errors(kind, 1, tmp_path)
    assert np.abs(z).max() < 4.0  # sigmas: one in 2000 sets of eight normal errors exceeds this


@pytest.mark.slow
def test_errors_of_forty_actuators_are_as_large_as_stated(tmp_path: Path) -> None:
    counts = {"nonlinear": 6, "linear": 3, "second-order": 3}
    chosen = [(kind, seed) for kind in KINDS for seed in range(counts.get(kind, 2))]
    z = np.concatenate([errors(kind, seed, tmp_path) for kind, seed in chosen])
    # The rms of 96 standard normal numbers is 1 +- 0.07.
    assert len(chosen) == 40
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.15)


def test_random_actuator_is_identified_from_all_outputs(tmp_path: Path) -> None:
    """Outputs computed from one quantity have the same errors; the delay has many local minima."""
    z = errors("nonlinear", 2, tmp_path, every=True)
    assert len(z) == 4
    assert np.abs(z).max() < 4.0  # sigmas, as above


@pytest.mark.slow
def test_errors_are_as_large_as_stated_with_every_output(tmp_path: Path) -> None:
    counts = {"nonlinear": 4, "linear": 6, "second-order": 6, "nonlinear+stribeck": 3, "worm-gear": 3}
    z = np.concatenate([errors(kind, seed, tmp_path, every=True) for kind, count in counts.items()
                        for seed in range(count)])
    assert len(z) >= 46  # of 52: a search may end in a local minimum, which is reported as a poor fit
    # The rms of 50 standard normal numbers is 1 +- 0.10; 1.5 times that. With independent outputs it would be 5.
    assert np.sqrt(np.mean(z**2)) == pytest.approx(1.0, abs=0.15)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[ParameterSet, list[Path]]:
    """A random second-order actuator and three of its records."""
    rng, base = np.random.default_rng(3), load_parameters(model="second-order")
    truth = random_truth(base, KINDS["second-order"][0], rng)
    return truth, records(truth, ("fin_angle", "fin_rate"), tmp_path_factory.mktemp("recorded"), rng, 3)


FREE = "second_order.natural_frequency,second_order.damping"


def changed(path: Path, folder: Path, **columns: Any) -> Path:
    """Write a record whose columns are changed by the functions, such as `fin_angle=lambda x: -x`; return its path."""
    head = path.read_text().splitlines()[0].split(",")
    table = dict(zip(head, np.loadtxt(path, delimiter=",", skiprows=1).T, strict=True))
    for name, change in columns.items():
        column = next(each for each in head if each.startswith(name))
        table[column] = change(table[column])
    new = folder / path.name
    np.savetxt(new, np.array(list(table.values())).T, delimiter=",", header=",".join(head), comments="", fmt="%.9g")
    return new


def test_command_writes_the_results_of_the_function(recorded: tuple[ParameterSet, list[Path]],
                                                    tmp_path: Path) -> None:
    truth, paths = recorded
    file, page, figures = (tmp_path / name for name in ("mine.toml", "fit.html", "fit.json"))
    command = emcas("calibrate", *paths[:3], "--model", "second-order", "--free", FREE, "--hold-out", paths[2],
                    "-o", file, "--report", page, "--json", figures)
    assert command.exit_code == 0, command.output
    assert all(f"{paths[2].name}, held out" in command.output and f" {name} " in command.output  # lines are not broken
               for name in ("fin_angle", "fin_rate", "second_order.natural_frequency"))
    assert str(file) in command.output
    result = api.calibrate(paths[:2], load_parameters(model="second-order"), FREE.split(","), paths[2:])
    document = json.loads(figures.read_text())
    loaded = load_parameters(file, model="second-order")
    for e in result.estimates[:2]:
        assert document["estimates"][e.name]["value"] == e.value
        assert loaded.values[e.name] == pytest.approx(e.value, abs=5e-3 * e.sigma)  # rounded
        entry = next(each for each in loaded.entries if each.variable.name == e.name)
        assert entry.source == "identified"
        assert f"1 sigma {e.sigma:.2g}" in entry.note
        assert abs(e.value - float(truth.values[e.name])) < 4.0 * e.sigma
    assert [(r.name, r.sha256, r.use.partition(";")[0]) for r in loaded.measured] == [
        (path.name, sha256(path.read_bytes()).hexdigest(), use)
        for path, use in zip(paths, ("fitted", "fitted", "held out"), strict=True)]
    for c in result.comparisons:
        (use,) = (r.use for r in loaded.measured if r.sha256 == c.record.sha256)
        assert f"; {c.variable.name} rms {c.figures['rms']:.3g} {c.unit}, largest" in use
    held_out = [c for c in document["comparisons"] if c["held_out"]]
    assert {c["file"] for c in held_out} == {paths[2].name}
    assert {c["output"] for c in held_out} == {"fin_angle", "fin_rate"}
    # The residuals are the noise, also of the record that was not fitted.
    assert all(c["fit_percent"] > 100.0 - 120.0 * NOISE for c in document["comparisons"])
    text = page.read_text()
    assert "Measured against simulated" in text
    assert "held out" in text
    assert result.records[0].sha256[:12] in text


def test_pair_that_records_cannot_determine_is_named(tmp_path: Path) -> None:
    base = load_parameters()
    rng = np.random.default_rng(5)
    truth = random_truth(base, ("inertia.fin", "drive.current_gain"), rng)
    paths = records(truth, ("fin_angle", "motor_current"), tmp_path, rng)
    result = calibration.calibrate(paths, base, ["inertia.fin", "inertia.shaft", "drive.current_gain"])
    assert result.undetermined == [("inertia.fin", "inertia.shaft")]
    assert any("inertia.fin, inertia.shaft" in problem for problem in result.problems)


def test_error_or_problem_of_a_bad_record(recorded: tuple[ParameterSet, list[Path]], tmp_path: Path) -> None:
    _, paths = recorded

    def output(**columns: Any) -> Any:
        return emcas("calibrate", changed(paths[1], tmp_path, **columns), "--model", "second-order", "--free", FREE,
                     "--compare", "fin_angle")

    for columns, code, words in (
        ({"fin_angle": lambda x: -x}, 2, "its sign"),
        ({"fin_command": lambda x: -x}, 2, "its sign"),
        ({"fin_angle": np.radians}, 2, "write its unit"),
        ({"fin_command": lambda x: 0.0 * x}, 2, "an input's column is missing"),
        ({"time": lambda t: t + 0.02 * (t > 0.3)}, 2, "not equally spaced"),
        ({"fin_angle": lambda x: np.where(np.arange(len(x)) == 9, np.nan, x)}, 2, "not a finite number"),
        ({"fin_angle": lambda x: np.clip(x, None, 2.0)}, 1, "is clipped at"),
        ({"fin_angle": lambda x: np.interp(np.arange(ROWS) * 1.01, np.arange(ROWS), x)}, 1, "drifts by"),
    ):
        result = output(**columns)
        assert (result.exit_code, words in result.output.replace("\n", " ")) == (code, True), (words, result.output)


def test_error_names_the_wrong_argument(recorded: tuple[ParameterSet, list[Path]]) -> None:
    base, path = load_parameters(model="second-order"), recorded[1][0]
    natural = "second_order.natural_frequency"
    for arguments, words in (
        ({"free": []}, "no parameter is free"),
        ({"free": ["second_order.dampin"]}, "did you mean second_order.damping"),
        ({"free": ["second_order.damping=0.9..0.2"]}, "must rise"),
        ({"free": ["second_order.damping=0.2-0.9"]}, "LOWER..UPPER"),
        ({"free": [f"{natural}=1..900 deg"]}, natural),
        ({"free": ["fin.start_angle"]}, "give bounds"),
        ({"free": [natural], "priors": ["second_order.damping=0.7+-0.1"]}, "is not free"),
        ({"free": [natural], "priors": [f"{natural}=100+-0 rad/s"]}, "a sigma above 0"),
        ({"free": [natural], "priors": [f"{natural}=9e9+-1 rad/s"]}, "beyond the bounds"),
        ({"free": [natural], "compare": ["fin_angel"]}, "did you mean fin_angle"),
        ({"free": [natural], "compare": ["hinge_torque"]}, "has no column hinge_torque"),
        ({"free": [natural], "hold_out": [path]}, "there is no other record to fit"),
        ({"free": [natural], "seed": -1}, "seed = -1"),
    ):
        with pytest.raises(EmcasError, match=words):
            api.calibrate([path], base, **arguments)
    for name, words in (("encoder.enabled", "Boolean"), ("solver.max_tick", "at which the model"),
                        ("controller.sample_time", "at which the model"), ("friction.temperature", "give bounds")):
        with pytest.raises(EmcasError, match=words):
            api.calibrate([path], load_parameters(), [name])
    with pytest.raises(EmcasError, match="no column for an input"):
        api.calibrate([write(path.parent / "bare.csv", {"time": (np.arange(30.0), "s"), "fin_angle": (np.arange(30.0),
                                                                                                      "deg")})],
                      base, [natural])


def test_poor_or_unsettled_fit_is_reported(recorded: tuple[ParameterSet, list[Path]],
                                           monkeypatch: pytest.MonkeyPatch) -> None:
    base = load_parameters(model="second-order")
    wrong = base.with_values({"second_order.natural_frequency": 0.3 * float(
        recorded[0].values["second_order.natural_frequency"])})
    (line,) = calibration.calibrate(recorded[1][:1], wrong, ["second_order.damping"], compare=["fin_angle"]).problems
    assert "fin_angle (fitted) is explained poorly" in line
    for module, name in ((calibration, "_STEPS"), (calibration, "_EVALUATIONS"), (estimation, "_PASSES")):
        monkeypatch.setattr(module, name, 1)
    problems = calibration.calibrate(recorded[1][:1], base, FREE.split(",")).problems
    assert any("not settled: " in line and "after 1 steps" in line for line in problems)


def test_constant_output_has_no_fit_percentage(recorded: tuple[ParameterSet, list[Path]], tmp_path: Path) -> None:
    path = changed(recorded[1][0], tmp_path, fin_rate=lambda x: 0.0 * x)
    base, figures = load_parameters(model="second-order"), tmp_path / "fit.json"
    result = calibration.calibrate([path], base, FREE.split(","))
    assert [(c.variable.name, c.fit == "constant") for c in result.comparisons] == [
        ("fin_angle", False), ("fin_rate", True)]
    write_json(result.document(), figures)
    text = figures.read_text()
    assert "Infinity" not in text
    assert json.loads(text)["comparisons"][1]["fit_percent"] is None


def test_record_that_begins_in_motion_or_elsewhere(recorded: tuple[ParameterSet, list[Path]], tmp_path: Path) -> None:
    base = load_parameters(model="second-order")
    head, *rows = recorded[1][0].read_text().splitlines()
    cut = tmp_path / "cut.csv"
    cut.write_text("\n".join([head, *rows[130:]]), "utf-8")  # 5 ms after a step
    measured = np.loadtxt(recorded[1][0], delimiter=",", skiprows=1)[130:, head.split(",").index("fin_angle [deg]")]
    (line,) = (each for each in calibration.calibrate([cut], base, FREE.split(",")).problems if "at rest" in each)
    rate = float(line.partition("moves at ")[2].split()[0])
    assert rate == pytest.approx((measured[9] - measured[0]) / (9 * STEP), rel=0.05)  # noise: 0.01 deg of 2
    # The fin angle is not compared, but its column gives the start angle.
    truth = recorded[0].with_values({"fin.start_angle": radians(3.0)})
    elsewhere = records(truth, ("fin_angle", "fin_rate"), tmp_path, np.random.default_rng(6), 1)
    result = calibration.calibrate(elsewhere, base, FREE.split(","), compare=["fin_rate"])
    assert result.problems == []
    for e in result.estimates:
        assert abs(e.value - float(truth.values[e.name])) < 4.0 * e.sigma


def test_number_of_simultaneous_runs_changes_no_bit(recorded: tuple[ParameterSet, list[Path]],
                                                    monkeypatch: pytest.MonkeyPatch) -> None:
    base = load_parameters()
    loaded, outputs = replay.read(recorded[1][:1], base, ["fin_angle"])
    runs = replay.Replay(base, free_parameters(base, ["inertia.motor"]), loaded, outputs, False)
    points = np.array([[3e-4, 0.0], [3.2e-4, 0.0], [3.4e-4, 0.01]])
    before = runs.residuals(points)
    monkeypatch.setattr(replay, "_MOST", 1)
    np.testing.assert_array_equal(runs.residuals(points), before)


def test_delay_of_a_channel_is_identified(recorded: tuple[ParameterSet, list[Path]], tmp_path: Path) -> None:
    late = 3.4e-3
    grid = np.arange(ROWS) * STEP
    path = changed(recorded[1][1], tmp_path, fin_rate=lambda x: np.interp(grid - late, grid, x))
    result = calibration.calibrate([path], load_parameters(model="second-order"), FREE.split(","), delays=True)
    assert abs(result["delay of fin_rate"].value - result["delay of fin_angle"].value - late) < 5e-5  # 1/20 of a sample


def test_prior_counts_as_a_measurement(recorded: tuple[ParameterSet, list[Path]]) -> None:
    base, path = load_parameters(model="second-order"), recorded[1][:1]
    alone = calibration.calibrate(path, base, FREE.split(","))["second_order.damping"]
    far = alone.value + 2.0 * alone.sigma
    with_prior = calibration.calibrate(path, base, FREE.split(","), priors=[
        f"second_order.damping={far!r}+-{alone.sigma!r}"])["second_order.damping"]
    # Two equally certain values give their mean with 1/sqrt(2) of the uncertainty, up to nonlinearity.
    assert with_prior.value == pytest.approx(alone.value + alone.sigma, abs=0.3 * alone.sigma)
    assert with_prior.sigma == pytest.approx(alone.sigma / np.sqrt(2.0), rel=0.1)


def test_prior_that_the_records_contradict_is_reported(recorded: tuple[ParameterSet, list[Path]]) -> None:
    base, path, name = load_parameters(model="second-order"), recorded[1][:1], "second_order.damping"
    alone = calibration.calibrate(path, base, FREE.split(","))
    for away, reported in ((1.0, False), (20.0, True)):
        prior = f"{name}={alone[name].value + away * alone[name].sigma!r}+-{alone[name].sigma!r}"
        problems = calibration.calibrate(path, base, FREE.split(","), priors=[prior]).problems
        assert any(name in line and "sigma of this difference" in line for line in problems) == reported


def test_temperature_is_interpolated_linearly_between_its_bounds() -> None:
    (unknown,) = free_parameters(load_parameters(), ["friction.temperature=10..50 degC"])
    assert unknown.between(0.5) == pytest.approx(30.0)


def test_misspelt_columns_are_named(recorded: tuple[ParameterSet, list[Path]], tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text(recorded[1][0].read_text().replace("fin_rate", "fin_rates"), "utf-8")
    base = load_parameters(model="second-order")
    result = calibration.calibrate([path], base, FREE.split(","))
    assert "Columns of run.csv: inputs fin_command; compared fin_angle; not used fin_rates." in result.notes
    (line,) = result.problems
    assert line.startswith("run.csv: column fin_rates is not used; did you mean fin_rate?")
    path.write_text(recorded[1][0].read_text().replace("fin_command", "fin_comand"), "utf-8")
    with pytest.raises(EmcasError, match="did you mean fin_command"):
        calibration.calibrate([path], base, FREE.split(","))


def test_robust_fits_ignore_outliers(recorded: tuple[ParameterSet, list[Path]], tmp_path: Path) -> None:
    truth, paths = recorded
    name = "second_order.damping"
    path = changed(paths[1], tmp_path, fin_angle=lambda x: np.where(np.arange(ROWS) % 25 == 0, x + 3.0, x))
    base = load_parameters(model="second-order").with_values({
        "second_order.natural_frequency": truth.values["second_order.natural_frequency"]})
    plain, robust = (calibration.calibrate([path], base, [name], robust=each, compare=["fin_angle"])[name]
                     for each in (False, True))
    assert abs(robust.value - float(truth.values[name])) < 4.0 * robust.sigma
    assert robust.sigma < 0.3 * plain.sigma


def test_one_correlation_time_is_one_number(tmp_path: Path) -> None:
    """The record has no noise, and the model lacks no effect."""
    base = load_parameters(model="electrohydraulic")
    time = np.arange(101) * STEP
    angle = simulate(base.values, time[-1], STEP, model=base.model, fin_command=0.1)["fin_angle"]
    record = write(tmp_path / "step.csv", {"time": (time, "s"), "fin_command": (np.full(101, 0.1), "rad"),
                                           "fin_angle": (angle, "rad")})
    note = calibration.calibrate([record], base, ["valve.rated_flow"]).notes[-1]
    assert re.match(r"Residuals are correlated over [\d.]+ samples; ", note)
    assert "Long correlation times come from encoder counts, rounded digits or, if these errors are large, " in note


@pytest.mark.slow
def test_example_of_the_page_identifies_the_simulated_values(tmp_path: Path) -> None:
    """docs/tools/calibration.md has records without noise."""
    run_block("tools/calibration.md", "try", tmp_path)
    values = load_parameters(tmp_path / "mine.toml").values
    assert values["inertia.motor"] == pytest.approx(3.4e-4, rel=1e-3)  # one record, quantised
    assert values["drive.current_gain"] == pytest.approx(9.0, rel=1e-3)


@pytest.mark.parametrize("when", ["trying starting points", "fitting from starting points", "fitting"])
def test_ctrl_c_keeps_the_best_point(when: str, recorded: tuple[ParameterSet, list[Path]],
                                     monkeypatch: pytest.MonkeyPatch) -> None:
    def progress(name: str, _done: int, _total: int) -> None:
        if name == when:
            original = calibration.Replay.residuals
            calls = iter(range(1000))

            def interrupted(*arguments: Any) -> Any:
                if next(calls) == 3:
                    monkeypatch.setattr(calibration.Replay, "residuals", original)
                    raise KeyboardInterrupt
                return original(*arguments)

            monkeypatch.setattr(calibration.Replay, "residuals", interrupted)

    result = calibration.calibrate(recorded[1][:1], load_parameters(model="second-order"), FREE.split(","),
                                   progress=progress)
    assert result.stopped
    assert "stopped before the end" in result.problems[0]
    assert all(np.isfinite(e.value) and e.sigma > 0.0 for e in result.estimates)
