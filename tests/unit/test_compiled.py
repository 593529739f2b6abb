"""The compiled kernel gives the same bits as the Python kernel."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Iterator, Mapping
from math import nan, radians, sin
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.reference.cases import CASES
from emcas_fmu.runtime import batch, compiled, compiler, library
from emcas_fmu.runtime.batch import Batch
from emcas_fmu.runtime.compiled import parameter_row
from emcas_fmu.runtime.compiler import CompilerError
from emcas_fmu.simulation import KERNELS, respond_all, simulate
from tests.default_actuator import INPUTS, OUTPUTS, PARAMETERS
from tests.marks import others_slow

from ..simulation import CompiledCore, inputs_at_rest, new_core

COMMAND = inputs_at_rest(0.2, -20.0, 39.0)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_kernels_agree_on_every_reference_case(values: Mapping[str, Any], case: Any) -> None:
    stop = min(case.stop_time, 3.0)  # s; Python takes a second for this part of a long sweep
    rows = round(stop / case.step) + 1
    signals = {name: column[:rows] for name, column in case.inputs().items() if name != "time"}
    both = [simulate({**values, **case.overrides}, stop, case.step, kernel, **signals)
            for kernel in ("compiled", "python")]
    for name in (v.name for v in OUTPUTS):
        np.testing.assert_array_equal(both[0][name], both[1][name], err_msg=name)


@pytest.mark.parametrize("kernel", [CompiledCore, new_core])
def test_earlier_time_changes_nothing(values: Mapping[str, Any], kernel: Any) -> None:
    """Neither a whole sample nor a part of a tick before the time reached."""
    core, forward = kernel(values), kernel(values)
    for now, earlier in ((0.01, 0.009), (0.02005, 0.02002), (0.03005, 0.029)):
        expected = forward.run(now, COMMAND)
        assert core.run(now, COMMAND) == expected
        assert core.run(earlier, COMMAND) == expected
    assert core.run(0.05, COMMAND) == forward.run(0.05, COMMAND)


def test_failed_step_changes_nothing(values: Mapping[str, Any]) -> None:
    core, undisturbed = CompiledCore(values), CompiledCore(values)
    for time in (0.01, 0.02):
        assert core.run(time, COMMAND) == undisturbed.run(time, COMMAND)
        for end, inputs, message in ((0.03, inputs_at_rest(0.2, 1e300, 39.0), "finite|events"),
                                     (1e9, COMMAND, "ticks")):
            with pytest.raises(ArithmeticError, match=message):
                core.run(end, inputs)


_IMPOSSIBLE_TICK = """
from emcas_fmu.parameters import load_parameters
from tests.simulation import inputs_at_rest, new_core
core = new_core(load_parameters().values)
core.run(0.01, inputs_at_rest(0.2, 0.0, 39.0))
core.state = (core.state[0], 0xffff, *core.state[2:])  # period, position, ...
core.run(0.02, inputs_at_rest(0.2, 0.0, 39.0))
"""


def test_step_from_an_impossible_tick_ends() -> None:
    """A corrupt state may have a tick beyond the last of its sample; searching for it would not end."""
    subprocess.run([sys.executable, "-c", _IMPOSSIBLE_TICK], check=True, timeout=60)  # s; takes 2 s


def _inputs(count: int, time: float) -> np.ndarray:
    rows = np.zeros((count, len(INPUTS)))
    names = [v.name for v in INPUTS]
    rows[:, names.index("supply_voltage")] = 39.0
    rows[:, names.index("enable")] = 1.0
    rows[:, names.index("fin_command")] = [0.2 * sin(20.0 * time + i) for i in range(count)]
    rows[:, names.index("acceleration.x")] = np.arange(count)
    return rows


@pytest.mark.parametrize(("changes", "message"), [
    ({"drive.transport_delay": 0.1}, "at most 64 times"),
    ({"controller.sample_time": 0.0}, "controller.sample_time = 0"),
    ({"motor.resistance": nan}, "motor.resistance = nan"), ({"motor.resistence": 1.0}, "motor.resistence"),
    ({"encoder.multiplier": 3}, "must be 1, 2 or 4")])
def test_wrong_parameters_are_refused(values: Mapping[str, Any], changes: dict[str, Any], message: str) -> None:
    """Before memory is allocated, whose size depends on them."""
    bad = {**values, **changes}
    for kernel in KERNELS:
        with pytest.raises(ValueError, match=message):
            simulate(bad, 0.1, kernel=kernel)
    for make in (CompiledCore, lambda v: Batch(np.array([parameter_row(values), parameter_row(v)]), 2)):
        with pytest.raises(ValueError, match=message):
            make(bad)


def test_tables_of_wrong_shape_are_refused(values: Mapping[str, Any]) -> None:
    sets, columns = compiled.parameter_row(values)[np.newaxis], [np.zeros(5)] * len(INPUTS)
    for rows, inputs, message in ((sets[0], columns, "parameters have shape"), (sets[:, 1:], columns, "have shape"),
                                  (sets, columns[1:], f"{len(INPUTS) - 1} inputs"),
                                  (sets, [np.zeros(4), *columns[1:]], "shape"),
                                  (np.repeat(sets, 3, axis=0), [np.zeros((2, 5)), *columns[1:]], "shape")):
        with pytest.raises(ValueError, match=message):
            compiled.run_tables(rows, inputs, 1e-3, ["fin_angle"])
    empty = compiled.run_tables(sets, [np.zeros(0)] * len(INPUTS), 1e-3, ["fin_angle"])
    assert empty.columns["fin_angle"].shape == (1, 0)
    assert not empty.failures
    with pytest.raises(TypeError, match="mapping"):
        compiled.parameter_row([1.0])  # type: ignore[arg-type]


@pytest.mark.parametrize("kernel", KERNELS[1:])
def test_many_runs_agree_with_single_runs(values: Mapping[str, Any], kernel: str) -> None:
    """Inputs differ by run and row, by run, or not at all. Runs that fail do not change the others."""
    rows, step, held = 12, 2e-4, 5  # each row of the inputs acts for `held` steps
    sets = np.stack([compiled.parameter_row({**values, "friction.temperature": t, "mass.fin": 2.0})
                     for t in (24.0, -5.0, 500.0, 10.0, 10.0)])
    tables = np.stack([np.repeat(_inputs(1, k * 1e-3), len(sets), axis=0) for k in range(rows)], axis=1)
    by_run = (2, 5)  # an acceleration and an angular rate
    tables[:, :, by_run] = np.arange(len(sets))[:, np.newaxis, np.newaxis]
    tables[3, 7, 1], tables[4, 4, 1] = nan, 1e300
    inputs = [tables[..., i] if i < 2 else tables[:, :1, i] if i in by_run else tables[0, 0, i]
              for i in range(len(INPUTS))]
    outputs = ["fin_rate", "motor_current"]
    together = respond_all(sets, inputs, step, outputs, kernel, held=held, fine=["motor_current"])
    for run, kind, message in ((2, ValueError, "friction.temperature"), (4, ArithmeticError, "at 0.00"),
                               (3, ValueError, "input aero_torque is nan at 0.007")):
        assert isinstance(together.failures[run], kind)
        assert str(together.failures[run]).startswith(message)
    assert len(together.failures) == 3
    for run in (0, 1):
        table = np.repeat(tables[run], held, axis=0)[:1 - held]
        run_values = {**values, **dict(zip((v.name for v in PARAMETERS), sets[run], strict=True))}
        alone = simulate(run_values, (len(table) - 1) * step, step, kernel,
                         **dict(zip((v.name for v in INPUTS), table.T, strict=True)))
        np.testing.assert_array_equal(together.columns["fin_rate"][run], alone["fin_rate"][::held])
        np.testing.assert_array_equal(together.columns["motor_current"][run], alone["motor_current"])
    assert np.isnan(together.columns["fin_rate"][2]).all()
    reached = together.reached[4]
    assert 4 * held < reached <= 5 * held
    np.testing.assert_array_equal(np.isnan(together.columns["motor_current"][4]), np.arange(56) >= reached)


@pytest.mark.parametrize(("stop", "step"), [(-1.0, 1e-3), (1.0, 0.0), (1.0, -1e-3), (nan, 1e-3), (1.0, nan),
                                            (0.0, 1e-3), (1.0, 1e-12), (1e-6, 1e-3)])
def test_wrong_times_of_a_run_are_refused(values: Mapping[str, Any], stop: float, step: float) -> None:
    with pytest.raises(ValueError, match="every"):
        simulate(values, stop, step)


def test_wrong_inputs_are_refused(values: Mapping[str, Any]) -> None:
    with pytest.raises(TypeError, match="no input 'rudder'"):
        simulate(values, 0.1, rudder=1.0)
    with pytest.raises(ValueError, match=r"aero_torque is nan at 0\.002 s"):
        simulate(values, 0.01, aero_torque=lambda t: nan if t > 0.0015 else 0.0)
    with pytest.raises(ValueError, match="11 communication points"):
        simulate(values, 0.01, aero_torque=np.zeros(7))
    with pytest.raises(EmcasError, match="auto, compiled, python"):
        simulate(values, 0.01, kernel="fortran")
    for kernel in KERNELS[1:]:
        with pytest.raises(ArithmeticError):
            simulate(values, 0.01, kernel=kernel, aero_torque=1e300)


SMALL = "second-order"  # its kernel compiles fastest


@pytest.fixture
def uncached(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Path]:
    monkeypatch.setattr(library, "cache_directory", lambda: tmp_path)
    library._library.cache_clear()
    yield tmp_path
    monkeypatch.undo()
    library._library.cache_clear()


def test_kernel_is_compiled_once(uncached: Path) -> None:
    assert library.available(SMALL)
    (kernel,) = uncached.glob("kernel_*")
    modified = kernel.stat().st_mtime_ns
    library._library.cache_clear()
    assert library.available(SMALL)
    assert [p.stat().st_mtime_ns for p in uncached.iterdir()] == [modified]


@pytest.mark.parametrize("damage", others_slow([b"", b"garbage", None], lambda damage: damage == b"garbage"))
def test_damaged_library_is_compiled_again(uncached: Path, damage: bytes | None) -> None:
    assert library.available(SMALL)
    (kernel,) = uncached.glob("kernel_*")
    whole = kernel.read_bytes()
    kernel.unlink()
    kernel.write_bytes(whole[:9000] if damage is None else damage)
    library._library.cache_clear()
    assert library.available(SMALL)
    (again,) = uncached.glob("kernel_*")
    assert again.read_bytes() == whole


def test_many_threads_compile_one_kernel(uncached: Path) -> None:
    available: list[bool] = []
    workers = [threading.Thread(target=lambda: available.append(library.available())) for _ in range(8)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert available == [True] * 8
    assert len(list(uncached.iterdir())) == 1


def test_broken_cc_is_replaced_by_the_next_compiler(uncached: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compiler.system.cache_clear()
    monkeypatch.setenv("CC", "false")
    assert not any("false" in c.command[0] for c in compiler.local_compilers())
    assert library.available(SMALL)
    monkeypatch.setenv("CC", "cc -DSOME_FLAG")
    assert next(compiler.local_compilers()).command[1:] == ("-DSOME_FLAG",)


def test_short_runs_do_not_compile(uncached: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Python computes them; a longer run compiles the kernel, which later runs may use. All results are equal."""
    monkeypatch.setattr(library, "_steps", defaultdict(float))
    values = load_parameters(model=SMALL).values
    runs = [simulate(values, 1.0, 1e-3, model=SMALL, fin_command=0.1)]
    assert not list(uncached.iterdir())
    simulate(values, (library.WORTH_COMPILING - 1000) * 1e-3, 1e-3, model=SMALL)
    (kernel,) = uncached.iterdir()
    for steps in (0.0, 100.0 * library.WORTH_COMPILING):
        monkeypatch.setattr(library, "_steps", defaultdict(float, {(SMALL, 1): steps}))
        runs.append(simulate(values, 1.0, 1e-3, model=SMALL, fin_command=0.1))
    assert list(uncached.iterdir()) == [kernel]
    assert all(np.array_equal(run[name], runs[0][name]) for run in runs for name in run)


@pytest.mark.parametrize(("lanes", "enough"), [(1, 1000), (8, 2 * batch.STEPS)])
def test_cached_kernel_is_used_for_fewer_steps(lanes: int, enough: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """From one second of a single actuator, or two actuators of a batch."""
    monkeypatch.setattr(library, "_is_cached", lambda *_: True)
    monkeypatch.setattr(library, "_steps", defaultdict(float))
    assert not library.worth(SMALL, enough - 1, lanes)
    assert library.worth(SMALL, 1, lanes)


def test_steps_of_all_runs_count_for_compiling(monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps at the rows of the inputs and between."""
    counts = list[float]()
    monkeypatch.setattr(library, "worth", lambda _, steps: counts.append(steps))
    values = load_parameters(model=SMALL).values
    inputs = [np.atleast_1d(v.initial(values)) for v in get(SMALL).inputs]
    inputs[0] = np.zeros((3, 7))
    respond_all(parameter_row(values, SMALL)[np.newaxis], inputs, 1e-3, ["fin_angle"], model=SMALL, held=2)
    assert counts == [3 * (6 * 2 + 1)]


def test_numpy_numbers_are_accepted_as_parameters(values: Mapping[str, Any]) -> None:
    """Also NumPy's Booleans; optimisers pass them."""
    of_numpy = {name: np.bool_(v) if isinstance(v, bool) else np.float64(v) for name, v in values.items()}
    one, other = (simulate(each, 0.02, kernel="python", fin_command=radians(5)) for each in (of_numpy, values))
    assert all(np.array_equal(one[name], other[name]) for name in one)


def test_without_a_compiler_python_computes(uncached: Path, values: Mapping[str, Any],
                                            monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(library, "local_compilers", lambda: iter(()))
    monkeypatch.setattr(library, "worth", lambda *_: True)
    result = simulate(values, 0.05, fin_command=radians(5))
    monkeypatch.undo()
    np.testing.assert_array_equal(result["fin_angle"], simulate(values, 0.05, fin_command=radians(5))["fin_angle"])


def test_broken_compiler_is_logged_and_python_computes(
        uncached: Path, values: Mapping[str, Any], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(library, "local_compilers", lambda: iter([compiler.Compiler(("false",), "broken", False)]))
    monkeypatch.setattr(library, "worth", lambda *_: True)
    simulate(values, 0.01)
    assert "Python is used instead: false cannot compile" in caplog.text
    with pytest.raises(CompilerError, match="false cannot compile"):
        simulate(values, 0.01, kernel="compiled")
    assert not list(uncached.iterdir())


@pytest.mark.parametrize(("system", "machine", "platform"), [
    ("Linux", "x86_64", "linux64"), ("Linux", "aarch64", "aarch64-linux"), ("Windows", "AMD64", "win64"),
    ("Darwin", "x86_64", "darwin64"), ("Darwin", "arm64", "darwin64"), ("Linux", "riscv64", None)])
def test_platform_of_a_machine(monkeypatch: pytest.MonkeyPatch, system: str, machine: str,
                               platform: str | None) -> None:
    monkeypatch.setattr("platform.system", lambda: system)
    monkeypatch.setattr("platform.machine", lambda: machine)
    local = compiler.local_platform()
    assert (local.name if local else None) == platform
