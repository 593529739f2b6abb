"""Parameters tuned during the run, in any order of calls: both FMUs use and refuse them at the same calls."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from emcas_fmu.fmi.interface import FmuInterface, fin_sets
from emcas_fmu.parameters import load_parameters

from ..fmu.built import lean, slave_class, unpacked
from ..fmu.host import DISCARD, OK, Fmu, Instance, Instance3

STEP = 7e-4  # s; it does not divide the sample time
ACCELERATION, JERK, GAIN = "trajectory.acceleration_limit", "trajectory.jerk_limit", "controller.antiwindup"
PHASE = "fault.phase_loss.angle"  # acts on outputs without a step


class Both:
    """The Python and the native FMU with the same calls; every result is compared."""

    def __init__(self, fmu: Fmu, slave: Any, interface: FmuInterface) -> None:
        self.fmu, self.slave, self.interface = fmu, slave, interface
        self.prefix = "" if interface.fins == 1 else "fin[2]."
        self.time, self.states = 0.0, []  # type: float, list[tuple[Any, ...]]
        self.native = Instance(fmu)
        self.begin()

    def begin(self) -> None:
        self.python, self.time = self.slave(instance_name="fin"), 0.0
        self.python.setup_experiment(0.0)
        self.python.enter_initialization_mode()
        assert [self.native.setup(), self.native.enter()] == [OK, OK]
        for name, value in {"fault.phase_loss.active": True, "controller.sample_time": 2e-3, GAIN: 100.0}.items():
            self.set(name, value)
        self.python.exit_initialization_mode()
        assert self.native.call("ExitInitializationMode") == OK

    def set(self, name: str, value: Any) -> None:
        name = self.prefix + name
        if self.prefix and isinstance(self.native, Instance3):  # it reads the array of all fins
            self.python.get_real([self.interface.reference[name]])
        put = self.python.set_boolean if isinstance(value, bool) else self.python.set_real
        put([self.interface.reference[name]], [value])
        assert self.native.set(name, value) == OK

    def value(self, name: str) -> Any:
        value = self.native.get(self.prefix + name)
        assert self.python.get_real([self.interface.reference[self.prefix + name]]) == [value]
        return value

    def read(self) -> list[Any]:
        names = [v.name for v in self.interface.outputs if v.kind == "Real"]
        values = [self.native.get(name) for name in names]
        assert self.python.get_real([self.interface.reference[name] for name in names]) == values
        return values

    def step(self) -> bool:
        """Return whether the step was computed; the messages are the same, and a refused step changes nothing."""
        self.native.log.clear()
        self.python.log_queue.clear()
        done: bool = self.python.do_step(self.time, STEP)
        assert self.native.step(self.time, STEP) == (OK if done else DISCARD), self.native.log
        assert "; ".join(text for status, text in self.native.log if status == DISCARD) == "".join(
            message.msg for message in self.python.log_queue if message.status == DISCARD)
        assert done or self.native.messages(DISCARD)
        if isinstance(self.native, Instance3):
            assert self.native.reached == (self.time + STEP if done else self.time)
        else:
            assert self.native.status("Boolean", 3) == (OK, not done)  # fmpy ends instead of repeating the step
        self.time += STEP * done
        self.read()
        return done

    def save(self) -> None:
        self.states.append((self.python._get_fmu_state(), self.native.save(), self.time))

    def restore(self) -> None:
        """Restore the last saved state in the same instances."""
        if self.states:
            python, native, self.time = self.states[-1]
            self.python._set_fmu_state(python)
            assert self.native.call("SetFMUstate", native) == OK

    def store(self) -> None:
        """Serialize the state, and continue from it in new instances."""
        python, native = self.python, self.native
        self.python, self.native = self.slave(instance_name="other"), Instance(self.fmu)
        data = python._fmu_state_to_bytes(python._get_fmu_state())
        self.python._set_fmu_state(python._fmu_state_from_bytes(data))
        assert self.native.restore(native.serialize(native.save())) == OK, self.native.log

    def reset(self) -> None:
        assert self.native.call("Reset") == OK
        self.begin()


@pytest.fixture(scope="module", params=[
    pytest.param((1, "2"), id="one fin"), pytest.param((2, "3"), id="two fins in FMI 3"),
    pytest.param((2, "2"), id="two fins", marks=pytest.mark.slow),
    pytest.param((1, "3"), id="one fin in FMI 3", marks=pytest.mark.slow)])
def built(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    (fins, fmi), folder = request.param, tmp_path_factory.mktemp("tuned")
    parameters = load_parameters(model="nonlinear+trajectory+faults").with_values(
        {"trajectory.natural_frequency": "200 rad/s", GAIN: "800 1/s"})  # this gain is too high for 2 ms
    interface = FmuInterface(fins, parameters.model)
    sets = [parameters.values] if fins == 1 else [each.values for each in fin_sets(parameters, fins)]
    fmu = unpacked(lean(parameters, folder / "x.fmu", fins=fins, fmi=fmi), folder)
    return fmu, slave_class(interface, sets), interface


@pytest.fixture
def both(built: Any) -> Both:
    return Both(*built)


@pytest.fixture
def pair(built: Any) -> tuple[Both, Both]:
    """Two runs after the same five steps."""
    pair = Both(*built), Both(*built)
    for each in pair:
        run(each, 5)
    return pair


@pytest.fixture(autouse=True)
def quiet(capsys: pytest.CaptureFixture[str]) -> Iterator[None]:
    yield
    capsys.readouterr()


def run(both: Both, steps: int = 20) -> list[Any]:
    both.set("fin_command", 0.2)
    return [both.step() and both.read() for _ in range(steps)]


def test_parameters_that_belong_together_are_set_in_two_calls(built: Any) -> None:
    """In both orders; one of them breaks the rule between the calls, and the outputs may be read there."""
    orders = []
    for factor, first, second in ((3.0, ACCELERATION, JERK), (3.0, JERK, ACCELERATION), (0.3, JERK, ACCELERATION)):
        both = Both(*built)
        run(both, 3)
        for name in (first, second):
            both.set(name, factor * both.value(name))
            both.read()
        assert both.step()
        orders.append(run(both))
    assert orders[0] == orders[1] != orders[2]


def test_a_refused_step_changes_nothing_and_a_right_value_goes_on(pair: tuple[Both, Both]) -> None:
    both, undisturbed = pair
    right = both.value(GAIN)
    both.set(GAIN, 1e4)
    assert [both.step(), both.step()] == [False, False]
    assert "controller.antiwindup = 10000 1/s must be at most" in both.native.messages(DISCARD)
    both.set(GAIN, right)
    assert run(both) == run(undisturbed)


def test_outputs_do_not_change_while_parameters_break_a_rule(both: Both) -> None:
    run(both)
    before = both.read()
    both.set(GAIN, 1e4)
    both.set(PHASE, 0.4)
    both.set("fin_command", -0.1)
    assert both.read() == before
    both.set(GAIN, 100.0)
    assert both.read() != before


def test_states_keep_parameters_that_break_a_rule(pair: tuple[Both, Both]) -> None:
    """A state that is restored, or stored and continued elsewhere, refuses the step until the parameter is mended."""
    both, undisturbed = pair
    right = both.value(GAIN)
    both.set(GAIN, 1e4)
    both.set(PHASE, 0.4)
    before = both.read()
    both.save()
    both.store()
    assert both.read() == before
    assert not both.step()
    both.set(GAIN, right)
    assert both.step()
    both.restore()
    assert both.read() == before
    assert not both.step()
    both.set(GAIN, right)
    undisturbed.set(PHASE, 0.4)
    assert run(both) == run(undisturbed)
    both.set(GAIN, 1e4)
    both.reset()
    undisturbed.reset()
    assert run(both) == run(undisturbed)


def test_parameters_tuned_before_a_state_is_restored_have_no_effect(both: Both) -> None:
    """Also if the instance has used them."""
    run(both, 3)
    both.save()
    expected = run(both)
    for tuned in ({GAIN: 1e4}, {PHASE: 0.4}, {PHASE: 0.8, GAIN: 1e4}):
        for name, value in tuned.items():
            both.set(name, value)
        both.step()
        both.restore()
        assert run(both) == expected


_calls = st.one_of(
    st.tuples(st.just("set"), st.sampled_from([(GAIN, 1e4), (GAIN, 100.0), (GAIN, 400.0), (ACCELERATION, 100.0),
                                               (ACCELERATION, 1e4), (JERK, 3e4), (JERK, 3e6), (PHASE, 0.4),
                                               (PHASE, 0.0), ("fin_command", 0.3), ("fin_command", -0.1)])),
    st.tuples(st.sampled_from(["step", "step", "read", "save", "restore", "store", "reset"]), st.just(())))


@settings(derandomize=True, max_examples=60,
          suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(calls=st.lists(_calls, max_size=25))
@example(calls=[("save", ()), ("reset", ()), ("restore", ()), ("step", ())])
def test_any_order_of_calls(built: Any, calls: list[tuple[str, tuple[Any, ...]]]) -> None:
    both = Both(*built)
    for name, arguments in calls:
        getattr(both, name)(*arguments)
    both.step()
