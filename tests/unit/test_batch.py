"""Many actuators side by side, through the Python API; vectors against the loop are in tests/parity."""

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
from emcas_fmu.simulation import simulate as of_kernel

BASE = load_parameters()


def test_each_moves_as_it_does_alone() -> None:
    """To the bit; inputs hold until they are given anew, and the outputs are where they were."""
    sets = [BASE, BASE.with_values({"friction.temperature": "-6 degC"})]
    batch = Batch(sets)
    outputs = batch.run(0.01, fin_command=0.1)
    angle = outputs["fin_angle"]
    batch.run(0.02, aero_torque=np.array([0.0, -20.0]))
    assert (len(batch), batch.time) == (2, 0.02)
    for k, (each, load) in enumerate(zip(sets, (0.0, -20.0), strict=True)):
        alone = of_kernel(each.values, 0.02, 0.01, fin_command=0.1, aero_torque=[0.0, load, load])
        assert angle[k] == batch.outputs["fin_angle"][k] == alone["fin_angle"][-1]


def test_memory_is_for_the_longest_delay_line() -> None:
    """Two delays that are kept in samples, and two more values, of the actuator that has most."""
    schedules = np.outer([2.0, 5.0, 3.0], np.ones(len(Schedule._fields)))
    assert longest_line(schedules) == 5 + 5 + 2


def test_outputs_are_there_from_the_start() -> None:
    start = of_kernel(BASE.values, 1e-3, 1e-3)
    batch = Batch(BASE, 3)
    for name, column in batch.outputs.items():
        np.testing.assert_array_equal(column, np.full(3, start[name][0]), err_msg=name)


def test_what_is_refused_leaves_nothing_behind() -> None:
    batch = Batch([BASE, BASE])
    batch.run(0.02, fin_command=0.1)
    with pytest.raises(EmcasError, match="no input torque"):
        batch.run(0.03, fin_command=0.3, torque=1.0)
    for refused, said in ((float("nan"), "is nan"), ("5 kg", "does not measure"), (np.ones(3), "array of 2 values"),
                          (np.array([0.0, nan]), "is nan"), ("a", "'a'"), ([[1.0]], "array of 2 values"),
                          (object(), "expected a number, or an array of 2 values")):
        with pytest.raises(EmcasError, match=said):
            batch.run(0.03, aero_torque=5.0, fin_command=refused)  # type: ignore[arg-type]
    with pytest.raises(EmcasError, match=r"0.01 s is before the time reached, 0.02 s"):
        batch.run(0.01)
    with pytest.raises(EmcasError, match=r"^Batch.run: end = '30 ms': expected a number, .* in s$"):
        batch.run("30 ms")  # type: ignore[arg-type]
    after = batch.run(0.03, fin_command="0.1 rad")["fin_angle"]
    assert after[0] == of_kernel(BASE.values, 0.03, 0.01, fin_command=0.1)["fin_angle"][-1]


def test_what_cannot_be_followed_is_named_and_stays() -> None:
    batch = Batch(BASE, 3)
    batch.run(0.01, fin_command=0.1)
    before = batch.outputs["fin_angle"].copy()
    with pytest.raises(ArithmeticError, match="actuators 1: "):
        batch.run(0.02, aero_torque=np.array([0.0, 1e300, 0.0]))
    assert batch.outputs["fin_angle"][1] == before[1]
    assert batch.outputs["fin_angle"][0] == batch.outputs["fin_angle"][2] != before[0]
    with pytest.raises(ArithmeticError, match=r"actuators 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, \.\.\.: "):
        Batch(BASE, 12).run(0.02, aero_torque=1e300)


def test_parameters_by_column() -> None:
    """The same as a set for each; an input that starts at a parameter starts at each actuator's."""
    name, values = "friction.temperature", np.array([24.0, 0.0, -20.0])
    columns, sets = Batch(BASE, 3, varied={name: values}), Batch([BASE.with_values({name: v}) for v in values])
    for batch in (columns, sets):
        batch.run(0.05, fin_command=0.2)
    np.testing.assert_array_equal(columns.outputs["fin_angle"], sets.outputs["fin_angle"])
    assert len(set(sets.outputs["fin_angle"])) == 3
    supplied = Batch(BASE, 2, varied={"drive.supply_voltage": np.array([39.0, 20.0])})
    assert len(set(supplied.run(0.02, fin_command=0.4)["fin_rate"])) == 2


@pytest.mark.parametrize(("given", "options", "said"), [
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
def test_says_what_cannot_be_a_batch(given: ParameterSet | list[ParameterSet], options: dict[str, object],
                                     said: str) -> None:
    with pytest.raises((EmcasError, ParameterError), match=said):
        Batch(given, **options)  # type: ignore[arg-type]


def test_threads_and_progress() -> None:
    """The same numbers by several threads of a batch, and by batches in several threads; progress ends at its total."""
    told: list[tuple[str, int, int]] = []
    batches = [Batch(BASE, 50, threads=2, progress=lambda *of: told.append(of)), Batch(BASE, 50), Batch(BASE, 50)]
    command = np.linspace(-0.2, 0.2, 50)

    def move(batch: Batch) -> None:
        for k in range(1, 20):
            batch.run(k * 1e-3, lambda *of: told.append(of), fin_command=command)

    workers = [threading.Thread(target=move, args=(batch,)) for batch in batches]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    for batch in batches[1:]:
        np.testing.assert_array_equal(batch.outputs["fin_angle"], batches[0].outputs["fin_angle"])
    assert {(what, done == total) for what, done, total in told} >= {("preparing actuators", True),
                                                                     ("moving actuators", True)}


def test_a_progress_that_raises_leaves_nothing_running() -> None:
    """As Ctrl-C does: what was begun by threads is over when the caller goes on, and the batch may be used on."""
    batch, alone = Batch(BASE, 64, threads=2), Batch(BASE, 64)

    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        batch.run(0.01, interrupt, fin_command=0.1)
    with pytest.raises(EmcasError, match="is before"):  # some are there already
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
def test_a_forked_child_has_threads_of_its_own() -> None:
    """Where it would wait for its parent's, which it does not have, for ever."""
    done = subprocess.run([sys.executable, "-W", "ignore", "-c", FORKED], capture_output=True, text=True, timeout=60)
    assert (done.stdout, done.stderr) == ("7\n", "")


def test_a_time_too_far_is_not_reached() -> None:
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
    every_other[:] = 0.0  # what is held is the caller's array
    batch.run(0.3)
    assert np.abs(angle).max() < 1e-2


def test_a_number_is_taken_as_it_is() -> None:
    """What repeats one value in memory, too: written over later, it changes nothing, whatever moves the actuators."""
    number = np.array(20.0)
    held, alone = (Batch(BASE.with_values({"mass.fin": 2.0}), 16) for _ in range(2))
    held.run(0.01, acceleration__z=number, aero_torque=np.broadcast_to(number, 16))
    alone.run(0.01, acceleration__z=20.0, aero_torque=20.0)
    number[...] = 300.0
    np.testing.assert_array_equal(held.run(0.1)["fin_angle"], alone.run(0.1)["fin_angle"])
    one = np.array([0.1])
    single = Batch(BASE, 1)
    single.run(0.01, fin_command=one)
    one[0] = 0.0
    assert abs(single.run(0.4)["fin_angle"][0]) < 1e-2


def test_arrays_however_they_lie_in_memory() -> None:
    """Backwards, in a record of odd length, of another type: the values are the same."""
    values = np.linspace(-0.1, 0.1, 4)
    record = np.zeros(4, dtype=[("flag", "i1"), ("command", "f8")])
    record["command"] = values
    angles = []
    for given in (values, values[::-1].copy()[::-1], record["command"], values.astype(">f8"), values.tolist()):
        batch = Batch(BASE, 4)
        angles.append(batch.run(0.02, fin_command=given)["fin_angle"].copy())
    for angle in angles[1:]:
        np.testing.assert_array_equal(angle, angles[0])


def test_without_a_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(library, "cache_directory", lambda: tmp_path)
    monkeypatch.setattr(library, "local_compilers", lambda: iter(()))
    library._library.cache_clear()
    with pytest.raises(EmcasError, match="install a C compiler"):
        Batch(BASE)
    monkeypatch.undo()
    library._library.cache_clear()


def test_shapes_of_the_kernel_s_batch() -> None:
    with pytest.raises(ValueError, match="at least one"):
        kernel.Batch(np.zeros((1, 1)), 0)
    with pytest.raises(ValueError, match=r"parameters have shape \(1, 1\)"):
        kernel.Batch(np.zeros((1, 1)), 3)
    row = np.array([[BASE.values[v.name] for v in BASE.actuator.parameters]], dtype=float)
    batch = kernel.Batch(row, 3)
    with pytest.raises(ValueError, match="nan s"):
        batch.run(nan)
