"""Four fins in one unit: what a single one does, four times over, and the bus and the mixing they share."""

from __future__ import annotations

import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator, Mapping
from math import radians
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import fromstring

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.fmi2.slave import Slave
from emcas_fmu.fmi.interface import AZIMUTH, FmuInterface, azimuths, fin_files
from emcas_fmu.fmi.package import BACKENDS, build
from emcas_fmu.parameters import load_parameters
from tests.default_actuator import OUTPUTS, PARAMETERS
from tests.marks import slow

from .built import slave_class as local_class
from .host import ERROR, OK, Fmu, Instance

pytestmark = pytest.mark.fmu

FOUR = FmuInterface(4)
RESISTANCE = "bus.source_resistance"


def unpacked(path: Path, folder: Path) -> Fmu:
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)
    return Fmu(str(folder))


@pytest.fixture(scope="module")
def built(shipped_unit: Callable[..., Path]) -> Mapping[str, Path]:
    """EMCAS4.fmu by back end."""
    return {backend: shipped_unit(backend, fins=4) for backend in BACKENDS}


@pytest.fixture(scope="module")
def four(built: Mapping[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    return unpacked(built["native"], tmp_path_factory.mktemp("unpacked") / "four")


@pytest.fixture(scope="module")
def one(native: Path, tmp_path_factory: pytest.TempPathFactory) -> Fmu:
    return unpacked(native, tmp_path_factory.mktemp("unpacked") / "one")


@pytest.fixture
def started(four: Fmu) -> Iterator[Any]:
    made: list[Instance] = []

    def start(**values: Any) -> Instance:
        instance = Instance(four)
        assert max(instance.initialize(**values)) == OK, instance.log
        made.append(instance)
        return instance

    yield start
    for instance in made:
        instance.free()


def commands(unit: Instance, angle: float) -> None:
    for fin in range(1, 5):
        assert unit.set(f"fin[{fin}].fin_command", angle) == OK


def angles(unit: Instance) -> list[float]:
    return [unit.get(f"fin[{fin}].fin_angle") for fin in range(1, 5)]


@pytest.mark.parametrize("backend", [*slow("python"), "native"])
def test_the_archive_is_a_valid_fmu_of_its_own_name(built: Mapping[str, Path], backend: str) -> None:
    assert validate_fmu(str(built[backend])) == []
    with zipfile.ZipFile(built[backend]) as archive:
        root = fromstring(archive.read("modelDescription.xml"))
        page = archive.read("documentation/index.html").decode()
    assert root.attrib["modelName"] == "EMCAS4"
    names = [v.attrib["name"] for v in root.findall("ModelVariables/ScalarVariable")]
    assert names == [v.name for v in FOUR.variables]
    assert {"fin[1].fin_command", "fin[4].at_stop", "fin[3].controller.position.kp", "attitude.roll", "supply_voltage",
            RESISTANCE} < set(names)
    for fin, azimuth in enumerate((45.0, 135.0, 225.0, 315.0), 1):
        start = root.find(f"ModelVariables/ScalarVariable[@name='fin[{fin}].{AZIMUTH}']/Real")
        assert start is not None
        assert float(start.attrib["start"]) == radians(azimuth)
    assert all(name in page for name in ("fin[2].fin_angle", "roll_command", "bus_voltage"))


def test_both_back_ends_share_a_guid_that_no_single_unit_has(built: Mapping[str, Path], native: Path) -> None:
    def guid(path: Path) -> str:
        with zipfile.ZipFile(path) as archive:
            return fromstring(archive.read("modelDescription.xml")).attrib["guid"]

    assert guid(built["python"]) == guid(built["native"]) != guid(native)


def test_on_a_stiff_bus_it_is_four_single_units(started: Any, one: Fmu) -> None:
    """Commands, hinge moments, acceleration, gravity, a bus that sags from outside, a drive switched off."""
    unit = started(**{f"fin[{k}].loads.gravity": True for k in range(1, 5)})
    singles = [Instance(one) for _ in range(4)]
    for single, azimuth in zip(singles, azimuths(4, "cross"), strict=True):
        assert max(single.initialize(**{AZIMUTH: radians(azimuth), "loads.gravity": True})) == OK
    rng = np.random.default_rng(5)
    time = 0.0
    for _ in range(25):
        shared = {"attitude.roll": rng.uniform(-3, 3), "attitude.pitch": rng.uniform(-1, 1),
                  "supply_voltage": rng.uniform(25, 40)}
        shared |= {f"acceleration.{axis}": rng.normal(0, 40) for axis in "xyz"}
        for name, value in shared.items():
            assert {unit.set(name, value), *(s.set(name, value) for s in singles)} == {OK}
        for fin, single in enumerate(singles, 1):
            for name, value in {"fin_command": rng.uniform(-0.4, 0.4), "aero_torque": rng.uniform(-90, 90),
                                "enable": rng.uniform() > 0.1}.items():
                assert {unit.set(f"fin[{fin}].{name}", value), single.set(name, value)} == {OK}
        for _ in range(20):
            assert {unit.step(time, 1.3e-3), *(s.step(time, 1.3e-3) for s in singles)} == {OK}
            time += 1.3e-3
            # Not only to 1e-12 rad: the same operations on the same numbers.
            assert angles(unit) == [s.get("fin_angle") for s in singles]
    for fin, single in enumerate(singles, 1):
        assert [unit.get(f"fin[{fin}].{v.name}") for v in OUTPUTS] == [single.get(v.name) for v in OUTPUTS]
    assert unit.get("supply_power") == pytest.approx(sum(s.get("supply_power") for s in singles), rel=1e-12)


@pytest.mark.parametrize(("mixing", "signs"), [
    # Right side down is a positive roll: the right panels' lift must point down, so their noses too.
    ("roll_command", (-1, -1, -1, -1)),
    # Tail fins at 45, 135, 225 and 315 deg from body y towards z: nose up by the right ones (1, 4) nose down.
    ("pitch_command", (-1, 1, 1, -1)),
    ("yaw_command", (-1, -1, 1, 1)),
])
def test_mixing_has_the_documented_signs(started: Any, mixing: str, signs: tuple[int, ...]) -> None:
    unit = started()
    assert unit.run(0.0, 1.0, 1e-2, **{mixing: 0.05}) == OK
    share = 1.0 if mixing == "roll_command" else 0.5**0.5
    # Held to the encoder's and the static accuracy, a twentieth of the commanded deflection.
    assert angles(unit) == pytest.approx([0.05 * share * sign for sign in signs], abs=0.0025)


def test_mixing_adds_to_the_commands(started: Any) -> None:
    one_way, other = started(), started()
    commands(one_way, 0.06)
    assert one_way.run(0.0, 0.2, 1e-3) == OK
    assert other.run(0.0, 0.2, 1e-3, roll_command=-0.06) == OK
    assert angles(one_way) == angles(other)


def test_the_bus_sags_by_its_resistance(started: Any) -> None:
    """V = V_source - R I holds at every communication point but for what the current changes in an update time."""
    unit = started(**{RESISTANCE: 0.02})
    commands(unit, 0.3)
    voltage, current = [], []
    for k in range(300):
        assert unit.step(k * 1e-3, 1e-3) == OK
        voltage.append(unit.get("bus_voltage"))
        current.append(unit.get("bus_current"))
        assert unit.get("bus_voltage") * unit.get("bus_current") == pytest.approx(unit.get("supply_power"), abs=1e-9)
    sag = 39.0 - np.array(voltage)
    # Four currents change by at most 4 V/L h = 4 x 80/0.6e-3 x 0.1e-3 = 53 A in an update time: 1.1 V.
    assert np.abs(sag - 0.02 * np.array(current)).max() < 1.1
    assert np.max(sag) > 3.0
    assert np.min(sag) < -0.1  # regeneration lifts it
    assert sag[-1] == pytest.approx(0.02 * current[-1], abs=1e-4)  # holding, 5 mA in an update time


def test_fins_share_what_the_bus_gives(started: Any) -> None:
    """A fin is slower when the other three move too, and as fast as ever on a stiff bus."""
    def travelled(resistance: float, together: bool) -> float:
        unit = started(**{RESISTANCE: resistance})
        commands(unit, 0.34 if together else 0.0)
        unit.set("fin[1].fin_command", 0.34)
        assert unit.run(0.0, 0.05, 1e-3) == OK
        return angles(unit)[0]

    assert travelled(0.0, True) == travelled(0.0, False)
    assert travelled(0.05, True) < 0.99 * travelled(0.05, False)


@pytest.mark.parametrize(("resistance", "supply", "inductance"), [
    (1.0, 39.0, 6e-4), (0.05, 5.0, 6e-4), (0.1, 15.0, 6e-4), (0.2, 20.0, 6e-4), (0.2, 0.5, 6e-4),
    (1.0, 39.0, 1e-4), (0.5, 20.0, 3e-5)])  # where sum R h/L is 4 and 7: without Newton's step the sag would swing
def test_a_weak_source_gives_no_more_than_it_has(started: Any, resistance: float, supply: float,
                                                 inductance: float) -> None:
    """At most V^2/4R, and V/R, for any demand of the drives: on average over the instants of the bus."""
    unit = started(**{RESISTANCE: resistance}, **{f"fin[{k}].motor.inductance": inductance for k in range(1, 5)})
    power, current = [], []
    for k in range(3000):
        if k == 100:
            commands(unit, 0.3)
        if k == 150:  # while they move
            unit.set("supply_voltage", supply)
        assert unit.step(k * 1e-4, 1e-4) == OK
        if k > 250:  # the motors' own inductance has let go, 10 ms after the change
            power.append(unit.get("supply_power"))
            current.append(unit.get("bus_current"))
    mean = np.convolve(power, np.ones(5) / 5, "valid"), np.convolve(current, np.ones(5) / 5, "valid")
    # The sag is an update late: what currents change by in 0.1 ms, a twentieth.
    assert mean[0].max() < 1.05 * supply**2 / (4.0 * resistance)
    assert mean[1].max() < 1.05 * supply / resistance
    assert mean[0].max() > 0.0


@pytest.mark.parametrize("resistance", [0.0, 0.05, 0.3])
def test_ramps_of_the_supply_do_not_depend_on_the_step(started: Any, resistance: float) -> None:
    """Input derivatives on a bus that sags: from dead to full in 20 ms, in one step or in twenty."""
    found = []
    for steps in (1, 4, 20):
        unit = started(**{RESISTANCE: resistance, "supply_voltage": 0.0})
        commands(unit, 0.3)
        size = 0.02 / steps
        for k in range(steps):
            unit.set("supply_voltage", 39.0 * k / steps)
            assert unit.differentiate("supply_voltage", 1, 39.0 / 0.02) == OK
            assert unit.step(k * size, size) == OK
        found.append([unit.get(n) for n in ("fin[1].fin_angle", "bus_voltage", "fin[1].motor_voltage", "bus_current")])
        assert abs(unit.get("fin[1].motor_voltage")) <= unit.get("bus_voltage") * (1.0 + 1e-12)
    # A tick takes a ramp at its middle: cut by a communication point, at the middles of both parts.
    assert np.abs(np.array(found[1:]) - found[0]).max() < 1e-3 * np.abs(found[0]).max()
    assert found[0][0] > 1e-4


def test_step_sizes_leave_the_trajectory_alone(started: Any) -> None:
    found = []
    for sizes in ([0.01], [0.001], [0.00037, 0.0013, 0.00083], [0.0001]):
        unit = started(**{RESISTANCE: 0.05})
        commands(unit, 0.3)
        time, k = 0.0, 0
        rows = []
        for end in np.arange(1, 11) * 0.01:
            while time < end - 1e-12:
                size = min(sizes[k % len(sizes)], end - time)
                assert unit.step(time, size) == OK
                time, k = time + size, k + 1
            rows.append([*angles(unit), unit.get("bus_voltage")])
        found.append(rows)
    for other in found[1:]:
        assert np.abs(np.array(other) - found[0]).max() < 1e-9  # the contract's, rad and V


def test_sag_converges_with_the_update_time(started: Any) -> None:
    """First order: halving the interval halves the error; the default is close."""
    def run(update: float) -> Any:
        unit = started(**{RESISTANCE: 0.05, "bus.update_time": update, **{
            f"fin[{k}].encoder.enabled": False for k in range(1, 5)}})
        commands(unit, 0.3)
        rows = []
        for k in range(100):
            assert unit.step(k * 1e-3, 1e-3) == OK
            rows.append(angles(unit)[0])
        return np.array(rows)

    finest = run(1e-5)
    errors = [np.abs(run(update) - finest).max() for update in (4e-4, 2e-4, 1e-4)]
    assert errors[0] > errors[1] > errors[2]
    slopes = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.all((slopes > 0.7) & (slopes < 1.6)), slopes  # of order one, against a reference that is not exact
    assert np.degrees(errors[2]) < 0.01  # of 17 deg; a fifth of the encoder's count, on a bus of twice a usual R


def test_states_are_kept_and_carried_over(started: Any) -> None:
    unit, other = started(**{RESISTANCE: 0.05}), started()
    commands(unit, 0.3)
    assert unit.run(0.0, 0.0203, 0.0007) == OK
    kept = unit.serialize(unit.save())
    assert unit.run(0.0203, 0.06, 0.0007) == OK
    assert other.restore(kept) == OK
    assert other.run(0.0203, 0.06, 0.0007) == OK
    assert other.outputs() == unit.outputs()
    spoiled = bytearray(kept)
    spoiled[-9] ^= 64
    assert other.restore(bytes(spoiled)) == ERROR


def test_bad_parameters_are_told_with_their_fin(four: Fmu) -> None:
    unit = Instance(four)
    assert max(unit.initialize(**{"fin[3].fin.stop_angle": 0.1})) == ERROR
    assert "fin[3]: fin.stop_angle = 0.1 rad" in unit.messages(ERROR)
    unit.log.clear()
    assert unit.set("fin[3].fin.stop_angle", 0.5) == OK
    assert unit.set(RESISTANCE, -1.0) == OK
    assert unit.call("ExitInitializationMode") == ERROR
    assert "bus.source_resistance = -1 is below its minimum 0" in unit.messages(ERROR)
    assert unit.set(RESISTANCE, 0.01) == OK
    assert unit.call("ExitInitializationMode") == OK
    assert unit.set("fin[2].fin_command", float("nan")) == OK
    assert unit.step(0.0, 1e-3) == ERROR
    assert "fin[2].fin_command = nan" in unit.messages(ERROR)
    unit.free()


# -- the Python back end ------------------------------------------------------


@pytest.fixture(scope="module")
def slave_class() -> type[Slave]:
    default = load_parameters().values
    sets = [{**default, AZIMUTH: radians(azimuth)} for azimuth in azimuths(4, "cross")]
    return local_class(FOUR, sets)


_fin = st.integers(1, 4)
_change = st.one_of(
    st.tuples(st.builds("fin[{}].fin_command".format, _fin), st.floats(-0.5, 0.5)),
    st.tuples(st.builds("fin[{}].aero_torque".format, _fin), st.floats(-200.0, 200.0)),
    st.tuples(st.builds("fin[{}].enable".format, _fin), st.booleans()),
    st.tuples(st.builds("fin[{}].controller.position.kp".format, _fin), st.floats(20.0, 90.0)),
    st.tuples(st.sampled_from(["roll_command", "pitch_command", "yaw_command"]), st.floats(-0.2, 0.2)),
    st.tuples(st.just("supply_voltage"), st.floats(0.0, 45.0)),
    st.tuples(st.sampled_from(["acceleration.z", "attitude.roll"]), st.floats(-3.0, 3.0)))


@settings(derandomize=True, max_examples=30,
          suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(resistance=st.sampled_from([0.0, 0.03, 0.5]), azimuth=st.floats(-3.0, 3.0), segments=st.lists(
    st.tuples(st.lists(_change, max_size=4), st.sampled_from([2.3e-4, 1e-3, 4.1e-3]), st.integers(1, 8), st.booleans()),
    min_size=1, max_size=5))
def test_both_back_ends_are_one_model(four: Fmu, slave_class: type[Slave], resistance: float, azimuth: float,
                                      segments: list[Any]) -> None:
    """In lockstep, states restored on the way: the same bits."""
    index = FOUR.reference
    native, python = Instance(four), slave_class(instance_name="fins")

    def put(name: str, value: Any) -> None:
        (python.set_boolean if isinstance(value, bool) else python.set_real)([index[name]], [value])
        assert native.set(name, value) == OK

    python.setup_experiment(0.0)
    python.enter_initialization_mode()
    assert [native.setup(), native.enter()] == [OK, OK]
    put(RESISTANCE, resistance)
    put(f"fin[2].{AZIMUTH}", azimuth)
    python.exit_initialization_mode()
    assert native.call("ExitInitializationMode") == OK
    time = 0.0
    for changes, size, steps, again in segments:
        for name, value in changes:
            put(name, value)
        saved = (slave_class._fmu_state_from_bytes(slave_class._fmu_state_to_bytes(python._get_fmu_state())),
                 native.serialize(native.save()), time)
        for _ in range(2 if again else 1):
            python._set_fmu_state(saved[0])
            assert native.restore(saved[1]) == OK, native.log
            time = saved[2]
            for _ in range(steps):
                done = python.do_step(time, size)
                assert done == (native.step(time, size) == OK), native.log
                if not done:
                    break
                time += size
        reals = [v.name for v in FOUR.outputs if v.kind == "Real"]
        assert python.get_real([index[name] for name in reals]) == [native.get(name) for name in reals]
    native.free()


def test_python_says_which_fin_is_wrong(slave_class: type[Slave], capsys: pytest.CaptureFixture[str]) -> None:
    slave = slave_class(instance_name="fins")
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    slave.set_real([FOUR.reference["fin[3].fin.stop_angle"]], [0.1])
    slave.exit_initialization_mode()
    assert not slave.do_step(0.0, 1e-3)
    assert "fin[3]: fin.stop_angle = 0.1 rad" in capsys.readouterr().err


def test_python_unit_runs_in_a_fresh_process(built: Mapping[str, Path], four: Fmu) -> None:
    code = ("import fmpy, sys\n"
            "r = fmpy.simulate_fmu(sys.argv[1], stop_time=0.1, output_interval=1e-3, start_values={"
            "'fin[2].fin_command': 0.1, 'bus.source_resistance': 0.02}, output=['fin[2].fin_angle', 'bus_voltage'])\n"
            "print(repr(float(r['fin[2].fin_angle'][-1])), repr(float(min(r['bus_voltage']))))")
    done = subprocess.run([sys.executable, "-c", code, built["python"]], capture_output=True, text=True, check=True)
    unit = Instance(four)
    assert max(unit.initialize(**{RESISTANCE: 0.02, "fin[2].fin_command": 0.1})) == OK
    assert unit.run(0.0, 0.1, 1e-3) == OK
    assert float(done.stdout.split()[0]) == pytest.approx(unit.get("fin[2].fin_angle"), abs=1e-9)  # the contract's
    assert float(done.stdout.split()[1]) < 38.9
    unit.free()


# -- the table ----------------------------------------------------------------


@pytest.mark.parametrize("fins", [1, 2, 3, 8])
def test_value_references_are_where_the_code_looks(fins: int) -> None:
    unit = FmuInterface(fins)
    names = [v.name for v in unit.variables]
    assert len(set(names)) == len(names)
    first, last = len(unit.inputs) + (3 if fins > 1 else 0), len(names) - fins * len(PARAMETERS)
    assert names[first:first + len(OUTPUTS)] == [unit.name(v.name, 0) for v in OUTPUTS]
    assert names[last + (fins - 1) * len(PARAMETERS):] == [unit.name(v.name, fins - 1) for v in PARAMETERS]


def test_unusual_units(tmp_path: Path) -> None:
    assert azimuths(4, "plus") == (0.0, 90.0, 180.0, 270.0)
    assert azimuths(3, "plus") == (0.0, 120.0, 240.0)
    (tmp_path / "low.toml").write_text('[drive]\nsupply_voltage = "28 V"\n')
    files = {2: tmp_path / "low.toml"}
    for call, said in ((lambda: FmuInterface(0), "an FMU has 1 to 8 fins"),
                       (lambda: FmuInterface(9), "an FMU has 1 to 8 fins"),
                       (lambda: azimuths(4, "star"), "choose plus or cross"),
                       (lambda: fin_files(["2=a.toml", "2=b.toml"]), "fin 2 appears twice"),
                       (lambda: fin_files(["two=a.toml"]), "expected a fin's number"),
                       (lambda: build(load_parameters(), tmp_path / "a.fmu", fins=4, files={5: tmp_path / "low.toml"}),
                        "the FMU has fins 1 to 4"),
                       (lambda: build(load_parameters(), tmp_path / "a.fmu", fins=4, files=files),
                        "low.toml: drive.supply_voltage differs between fins"),
                       (lambda: build(load_parameters(), tmp_path / "a.fmu", files=files), "several fins: set fins")):
        with pytest.raises(EmcasError, match=said):
            call()


def test_a_fin_may_differ(tmp_path: Path) -> None:
    """Its file goes over what all have, azimuth of the layout included."""
    (tmp_path / "worn.toml").write_text('[motor]\ntorque_constant = "0.09 N*m/A"\n'
                                        '[mounting]\nazimuth = "100 deg"\n')
    base = load_parameters().with_values({"motor.resistance": 0.3, AZIMUTH: 1.0})
    made = build(base, tmp_path / "EMCAS3.fmu", fins=3, layout="plus", files={2: tmp_path / "worn.toml"})
    with zipfile.ZipFile(made.path) as archive:
        root = fromstring(archive.read("modelDescription.xml"))

    def starts(name: str) -> list[float]:
        found = [root.find(f"ModelVariables/ScalarVariable[@name='fin[{k}].{name}']/Real") for k in (1, 2, 3)]
        return [float(each.attrib["start"]) for each in found if each is not None]

    assert starts("motor.torque_constant") == [0.11, 0.09, 0.11]
    assert starts("motor.resistance") == [0.3, 0.3, 0.3]
    assert starts(AZIMUTH) == pytest.approx([0.0, radians(100), radians(240)], rel=1e-15)  # decimal conversion


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("gcc") is None, reason="gcc is not installed")
def test_a_system_compiler_builds_it(tmp_path: Path) -> None:
    for fins in (1, 2):
        assert build(load_parameters(model="second-order"), tmp_path / f"{fins}.fmu", "native", cc="gcc",
                     fins=fins).platforms
