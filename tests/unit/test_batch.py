"""Many actuators at once, through the Python interface (tests/parity compares vectors with single actuators)."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from math import nan
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.api import Batch, load_parameters
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import ParameterError, ParameterSet
from emcas_fmu.runtime import batch as kernel
from emcas_fmu.runtime import library
from emcas_fmu.runtime.compiled import longest_line
from emcas_fmu.runtime.schedule import Schedule
from emcas_fmu.simulation import simulate as simulate_kernel

BASE = load_parameters()


def test_each_actuator_moves_as_alone() -> None:
    """To the bit. Inputs keep their values until changed, and the arrays of outputs are reused."""
    sets = [BASE, BASE.with_values({"friction.temperature": "-6 degC"})]
    batch = Batch(sets)
    outputs = batch.run(0.01, fin_command=0.1)
    angle = outputs["fin_angle"]
    batch.run(0.02, aero_torque=np.array([0.0, -20.0]))
    assert (len(batch), batch.time) == (2, 0.02)
    for k, (each, load) in enumerate(zip(sets, (0.0, -20.0), strict=True)):
        alone = simulate_kernel(each.values, 0.02, 0.01, fin_command=0.1, aero_torque=[0.0, load, load])
        assert angle[k] == batch.outputs["fin_angle"][k] == alone["fin_angle"][-1]


@pytest.mark.parametrize("spread", [0.0, 40.0], ids=["shared", "of each"])
def test_vehicle_motion_may_change_at_each_run(spread: float) -> None:
    """To the bit as alone, for an acceleration that all actuators share and for one that differs between them."""
    sets, levels = [BASE] * 5, (0.0, 60.0, 60.0, -90.0)
    batch, offsets = Batch(sets), np.linspace(0.0, spread, 5)
    for k, level in enumerate(levels):
        batch.run(0.01 * (k + 1), acceleration__z=level + offsets if spread else level, fin_command=0.1)
    for k, offset in enumerate(offsets):
        steps = [level + offset for level in (*levels, levels[-1])]
        alone = simulate_kernel(BASE.values, 0.04, 0.01, fin_command=0.1, acceleration__z=steps)
        assert batch.outputs["fin_angle"][k] == alone["fin_angle"][-1]
        assert batch.outputs["hinge_torque"][k] == alone["hinge_torque"][-1]


def test_memory_fits_the_longest_delay_buffer() -> None:
    """Two delays in samples, and two more values, of the actuator with the longest delays."""
    schedules = np.outer([2.0, 5.0, 3.0], np.ones(len(Schedule._fields)))
    assert longest_line(schedules) == 5 + 5 + 2


def test_outputs_have_start_values() -> None:
    start = simulate_kernel(BASE.values, 1e-3, 1e-3)
    batch = Batch(BASE, 3)
    for name, column in batch.outputs.items():
        np.testing.assert_array_equal(column, np.full(3, start[name][0]), err_msg=name)


def test_refused_run_changes_nothing() -> None:
    batch = Batch([BASE, BASE])
    batch.run(0.02, fin_command=0.1)
    with pytest.raises(EmcasError, match="no input torque"):
        batch.run(0.03, fin_command=0.3, torque=1.0)
    for command, message in ((float("nan"), "is nan"), ("5 kg", "does not measure"), (np.ones(3), "array of 2 values"),
                             (np.array([0.0, nan]), "is nan"), ("a", "'a'"), ([[1.0]], "array of 2 values"),
                             (object(), "expected a number, or an array of 2 values")):
        with pytest.raises(EmcasError, match=message):
            batch.run(0.03, aero_torque=5.0, fin_command=command)  # type: ignore[arg-type]
    with pytest.raises(EmcasError, match=r"0.01 s is before the time reached, 0.02 s"):
        batch.run(0.01)
    with pytest.raises(EmcasError, match=r"^Batch.run: end = '30 ms': expected a number, .* in s$"):
        batch.run("30 ms")  # type: ignore[arg-type]
    after = batch.run(0.03, fin_command="0.1 rad")["fin_angle"]
    assert after[0] == simulate_kernel(BASE.values, 0.03, 0.01, fin_command=0.1)["fin_angle"][-1]


def test_failing_actuator_is_named_and_does_not_move() -> None:
    batch = Batch(BASE, 3)
    batch.run(0.01, fin_command=0.1)
    before = batch.outputs["fin_angle"].copy()
    with pytest.raises(ArithmeticError, match="actuators 1: "):
        batch.run(0.02, aero_torque=np.array([0.0, 1e300, 0.0]))
    assert batch.outputs["fin_angle"][1] == before[1]
    assert batch.outputs["fin_angle"][0] == batch.outputs["fin_angle"][2] != before[0]
    with pytest.raises(ArithmeticError, match=r"actuators 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, \.\.\.: "):
        Batch(BASE, 12).run(0.02, aero_torque=1e300)


def test_varied_parameters_equal_a_set_for_each_actuator() -> None:
    """An input whose start value is a parameter starts at each actuator's value."""
    name, values = "friction.temperature", np.array([24.0, 0.0, -20.0])
    varied, sets = Batch(BASE, 3, varied={name: values}), Batch([BASE.with_values({name: v}) for v in values])
    angles = [batch.run(0.05, fin_command=0.2)["fin_angle"] for batch in (varied, sets)]
    np.testing.assert_array_equal(angles[0], angles[1])
    assert len(set(angles[0])) == 3
    supplied = Batch(BASE, 2, varied={"drive.supply_voltage": np.array([39.0, 20.0])})
    assert len(set(supplied.run(0.02, fin_command=0.4)["fin_rate"])) == 2


@pytest.mark.parametrize(("sets", "options", "message"), [
    ([], {}, "pass one parameter set"), ([BASE, BASE], {"count": 3}, "count = 3 needs exactly one"),
    (BASE, {"count": 0}, "a whole number from 1 to"), (BASE, {"count": 2.0}, "count = 2.0: expected a whole number"),
    (BASE, {"threads": 0}, "threads = 0"),
    (BASE, {"count": 2, "varied": {"friction.temp": 1.0}}, "no parameter friction"),
    (BASE, {"count": 2, "varied": {"friction.temperature": [1.0]}}, "array of 2 values"),
    (BASE, {"count": 2, "varied": {"friction.temperature": [1.0, 900.0]}}, "actuator 1: friction.temperature"),
    (BASE, {"count": 2, "varied": {"drive.supply_voltage": [39.0, -5.0]}}, "actuator 1: drive.supply_voltage = -5"),
    (BASE, {"count": 2, "varied": {"encoder.pulses": [1000.5, 1e3]}}, "actuator 0: encoder.pulses = 1000.5 is not a"),
    (BASE, {"count": 2, "varied": {"encoder.enabled": [1, 0.5]}}, "actuator 1: encoder.enabled = 0.5 is not a Boolean"),
    (BASE, {"count": 2, "varied": {"drive.transport_delay": [0.0, 0.1]}}, "actuator 1: .*at most 64 times")])
def test_wrong_batch_is_refused(sets: ParameterSet | list[ParameterSet], options: dict[str, object], message: str
                                ) -> None:
    with pytest.raises((EmcasError, ParameterError), match=message):
        Batch(sets, **options)  # type: ignore[arg-type]


def test_threads_give_the_same_outputs_and_progress_ends_at_its_total() -> None:
    """Several threads in a batch, and batches in several threads."""
    progress: list[tuple[str, int, int]] = []
    batches = [Batch(BASE, 50, threads=2, progress=lambda *of: progress.append(of)), Batch(BASE, 50), Batch(BASE, 50)]
    command = np.linspace(-0.2, 0.2, 50)

    def move(batch: Batch) -> None:
        for k in range(1, 20):
            batch.run(k * 1e-3, lambda *of: progress.append(of), fin_command=command)

    workers = [threading.Thread(target=move, args=(batch,)) for batch in batches]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    for batch in batches[1:]:
        np.testing.assert_array_equal(batch.outputs["fin_angle"], batches[0].outputs["fin_angle"])
    assert {(task, done == total) for task, done, total in progress} >= {
        ("preparing actuators", True), ("moving actuators", True)}


def test_interrupt_ends_all_threads() -> None:
    """An exception of the progress function acts like Ctrl-C: the threads end, and the batch is still usable."""
    batch, alone = Batch(BASE, 64, threads=2), Batch(BASE, 64)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        batch.run(0.01, interrupt, fin_command=0.1)
    with pytest.raises(EmcasError, match="is before"):  # some actuators have reached 10 ms
        batch.run(0.005)
    np.testing.assert_array_equal(batch.run(0.01)["fin_angle"], alone.run(0.01, fin_command=0.1)["fin_angle"])


FORKED = """
import os
import signal
from emcas_fmu import Batch, load_parameters
batch = Batch(load_parameters(), 64, threads=2)
batch.run(0.001, fin_command=0.1)
if not (child := os.fork()):
    signal.alarm(30)  # it must not outlive the test
    batch.run(0.01)
    os._exit(7 if batch.time == 0.01 else 1)
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
"""


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
def test_forked_child_starts_new_threads() -> None:
    """The parent's threads do not exist in the child, which would wait for them for ever."""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", FORKED], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("7\n", "")


def test_time_too_far_ahead_is_refused() -> None:
    batch = Batch(BASE, 2)
    with pytest.raises(ArithmeticError, match="actuators 0, 1: more than"):
        batch.run(1e12)
    assert batch.time == 0.0
    batch.run(0.01)


def test_inputs_and_outputs_are_not_copied() -> None:
    batch = Batch(BASE, 4)
    every_other = np.linspace(-0.1, 0.1, 8)[::2]
    angle = batch.outputs["fin_angle"]
    batch.run(0.02, fin_command=every_other)
    assert batch.outputs["fin_angle"] is angle
    every_other[:] = 0.0  # the batch reads the caller's array
    batch.run(0.3)
    assert np.abs(angle).max() < 1e-2


def test_single_numbers_are_copied() -> None:
    """A number in an array, also if broadcast to all actuators: later changes of the array have no effect."""
    number = np.array(20.0)
    arrays, numbers = (Batch(BASE.with_values({"mass.fin": 2.0}), 16) for _ in range(2))
    arrays.run(0.01, acceleration__z=number, aero_torque=np.broadcast_to(number, 16))
    numbers.run(0.01, acceleration__z=20.0, aero_torque=20.0)
    number[...] = 300.0
    np.testing.assert_array_equal(arrays.run(0.1)["fin_angle"], numbers.run(0.1)["fin_angle"])
    one = np.array([0.1])
    single = Batch(BASE, 1)
    single.run(0.01, fin_command=one)
    one[0] = 0.0
    assert abs(single.run(0.4)["fin_angle"][0]) < 1e-2


def test_arrays_of_any_memory_layout_are_equal() -> None:
    """Reversed, in a record of odd length, of another byte order, and a list."""
    values = np.linspace(-0.1, 0.1, 4)
    record = np.zeros(4, dtype=[("flag", "i1"), ("command", "f8")])
    record["command"] = values
    angles = []
    for command in (values, values[::-1].copy()[::-1], record["command"], values.astype(">f8"), values.tolist()):
        angles.append(Batch(BASE, 4).run(0.02, fin_command=command)["fin_angle"])
    for angle in angles[1:]:
        np.testing.assert_array_equal(angle, angles[0])


def test_batch_without_a_compiler_is_refused(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(library, "cache_directory", lambda: tmp_path)
    monkeypatch.setattr(library, "local_compilers", lambda: iter(()))
    library._library.cache_clear()
    with pytest.raises(EmcasError, match="install a C compiler"):
        Batch(BASE)
    monkeypatch.undo()
    library._library.cache_clear()


def test_kernel_batch_refuses_wrong_shapes_and_times() -> None:
    with pytest.raises(ValueError, match="at least one"):
        kernel.Batch(np.zeros((1, 1)), 0)
    with pytest.raises(ValueError, match=r"parameters have shape \(1, 1\)"):
        kernel.Batch(np.zeros((1, 1)), 3)
    row = np.array([[BASE.values[v.name] for v in BASE.actuator.parameters]], dtype=float)
    batch = kernel.Batch(row, 3)
    with pytest.raises(ValueError, match="nan s"):
        batch.run(nan)
