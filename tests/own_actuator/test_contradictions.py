"""Warnings of the first simulation about a user's wrong measured angle, reference limit or supply power."""

from __future__ import annotations

import re
from pathlib import Path
from shutil import copy

import pytest

from emcas_fmu.actuators import EXTENSIONS, NAMES, get, get_extension
from emcas_fmu.errors import EmcasError
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.marks import others_slow

from .example import FOLDER, changed
from .test_trial import simulate_briefly

_LIMITED = "ops.where(ops.both(inputs.enable, limited), 1.0, 0.0)"
_POWER = '"supply_power": voltage(ops, u) * x.current'
_MEASURED = '"measured_fin_angle": {}, "motor_current": x'


@pytest.mark.parametrize(("before", "after", "warning"), [
    ("ops.clip(u.reference, -u.supply, u.supply)", "0.1 * u.supply", "no motion depends on the reference of sample()"),
    (_LIMITED, "1.0", "saturated is always true, though fin_angle is commanded to stay"),
    (_LIMITED, "0.0", "returns limited = 0, but the reference is limited to 39; return limited"),
    (_LIMITED, "demand", "returns limited = -251.551, but the reference is limited to -39"),
    ('"motor_current": x', _MEASURED.format("-u.measured_fin_angle"), "measured_fin_angle is -19.13 deg where fin_an"),
    ('"motor_current": x', _MEASURED.format("57.3 * u.measured_fin_angle"), "measured_fin_angle is 1096 deg where f"),
    (_POWER, _POWER.replace("voltage", "-voltage"), "a supply_power whose energy is -0.218 J after 0.049 s, but the "),
    (_POWER, _POWER.replace("voltage", "0.5 * voltage"), "is 0.109 J after 0.049 s, but the motor consumes 0.21"),
    (_POWER, '"supply_power": 0.0 * x.current', "is 0 J after 0.007 s, but the fin's motion has 0.0102 J"),
    (_POWER, f"{_POWER} - 1e-9", "returns supply_power = -1e-09 W at rest while disabled"),
    (_POWER, f"{_POWER} + 3.0", ""),
])
def test_contradictions_of_the_outputs_are_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture, before: str,
                                                     after: str, warning: str) -> None:
    path = changed(tmp_path, (before, after))
    simulate_briefly(path)
    found = [warning in message and message.startswith(str(path)) for message in caplog.messages]
    assert found == [True] * bool(warning)


def test_a_command_without_effect_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = changed(tmp_path, ("em.fin_port.clipped_command(ops, p, inputs.command)", "0.0"))
    simulate_briefly(path)
    assert f"{path}, line 44: sample() returns the same for every inputs.command; use this input" in caplog.messages


def test_energy_of_a_spring_is_not_taken_for_the_supply_s(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """A drive with hardly any voltage on a stiff spring consumes hardly any power."""
    path = changed(tmp_path, ("ops.clip(u.reference, -u.supply, u.supply)", "ops.clip(1e-9 * u.reference, -u.supply, "
                              "u.supply)"))
    simulate_briefly(path)
    assert not [message for message in caplog.messages if "supply_power" in message]


def test_power_into_a_pressure_line_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Chambers store energy, but a fin without load returns none."""
    path, text = tmp_path / "mine.py", (FOLDER / "hot_gas.py").read_text(encoding="utf-8")
    path.write_text(text.replace("drawn = p.gas", "drawn = -p.gas"), encoding="utf-8")
    simulate_briefly(path)
    assert [message for message in caplog.messages if "returns a supply_power whose energy is -" in message]


def test_motor_angle_as_measured_fin_angle_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path, text = tmp_path / "mine.py", (FOLDER / "strain_wave.py").read_text(encoding="utf-8")
    path.write_text(text.replace('_angle": angle', '_angle": x.motor_angle'), encoding="utf-8")
    simulate_briefly(path)
    (message,) = caplog.messages
    assert re.search("measured_fin_angle is 199[78] deg where fin_angle is 19.97 deg", message)


@pytest.mark.parametrize(("before", "after", "name"), [
    ("now + start.encoder_offset", "now", "initial"),
    ("now + inputs.encoder_offset", "now - inputs.encoder_offset", "sample"),
])
def test_counts_without_encoder_offset_are_refused_with_homing(tmp_path: Path, before: str, after: str, name: str
                                                               ) -> None:
    """Without homing nothing depends on the offset."""
    geared = Path(__file__).with_name("geared.py")
    path, text = tmp_path / "mine.py", geared.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")
    copy(geared.with_suffix(".toml"), path.with_suffix(".toml"))
    simulate_briefly(path)
    with pytest.raises(EmcasError, match=rf"mine\.py, line \d+: {name}\(\) returns counts that an encoder_offset of 1"):
        simulate_briefly(f"{path}+homing")


# Extensions that change limit, power or measured angle. Power in motion is judged only without extensions.
RELEVANT = ("", "+efficiency", "+homing", "+saturation", "+sensors", "+supply")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one file for each actuator and all its extensions, so that the actuator is traced once."""
    return tmp_path_factory.mktemp("sound")


@pytest.mark.parametrize(("name", "extension"), others_slow(
    [(name, extension) for name in NAMES for extension in ("", *(
        f"+{each}" for each in EXTENSIONS if get(name).provides.issuperset(get_extension(each).needs)))
     if name == "nonlinear" or extension in RELEVANT],
    lambda case: case[0] == "nonlinear" and case[1] in RELEVANT))
def test_shipped_actuators_cause_no_such_warning(folder: Path, caplog: pytest.LogCaptureFixture, name: str,
                                                 extension: str) -> None:
    """The shipped actuators are declared in a user's file; other warnings about them are justified.

    The default actuator is tested with each extension, the others with the relevant ones.
    """
    path = folder / f"{name}.py"
    path.write_text("from dataclasses import replace\n\nfrom emcas_fmu.actuators import get\n\n"
                    f'ACTUATOR = replace(get("{name}"), name="mine")\n', encoding="utf-8")
    model = f"{path}{extension}"
    simulate(load_parameters(model=f"{name}{extension}").values, 0.002, kernel="python", model=model)
    assert [message for message in caplog.messages
            if re.search("limited|measured_fin_angle|supply_power|saturated", message)] == []
