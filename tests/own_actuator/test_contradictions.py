"""What a sample and the outputs return for the port: a wrong angle, limit or power is seen at the first simulation."""

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

_LIMITED = "ops.where(ops.both(inputs.enable, limited), 1.0, 0.0)"
_POWER = '"supply_power": voltage(ops, u) * x.current'
_MEASURED = '"measured_fin_angle": {}, "motor_current": x'


@pytest.mark.parametrize(("before", "after", "says"), [
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
def test_what_is_seen(tmp_path: Path, caplog: pytest.LogCaptureFixture, before: str, after: str, says: str) -> None:
    path = changed(tmp_path, (before, after))
    simulate(load_parameters(model=str(path)).values, 0.002, kernel="python", model=str(path))
    assert [says in message and message.startswith(str(path)) for message in caplog.messages] == [True] * bool(says)


def test_a_command_without_effect(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """It is named beside the fin that therefore leaves its angle."""
    path = changed(tmp_path, ("em.fin_port.clipped_command(ops, p, inputs.command)", "0.0"))
    simulate(load_parameters(model=str(path)).values, 0.002, kernel="python", model=str(path))
    assert f"{path}, line 44: sample() returns the same for every inputs.command; use this input" in caplog.messages


def test_a_spring_that_drives(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Its energy is not the supply's: a drive of hardly any voltage, on a stiff spring, draws hardly any power."""
    path = changed(tmp_path, ("ops.clip(u.reference, -u.supply, u.supply)", "ops.clip(1e-9 * u.reference, -u.supply, "
                              "u.supply)"))
    simulate(load_parameters(model=str(path)).values, 0.002, kernel="python", model=str(path))
    assert not [message for message in caplog.messages if "supply_power" in message]


def test_a_line_that_is_fed(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Chambers store energy, but a fin without load returns none."""
    path, text = tmp_path / "mine.py", (FOLDER / "hot_gas.py").read_text(encoding="utf-8")
    path.write_text(text.replace("drawn = p.gas", "drawn = -p.gas"), encoding="utf-8")
    simulate(load_parameters(model=str(path)).values, 0.002, kernel="python", model=str(path))
    assert [message for message in caplog.messages if "returns a supply_power whose energy is -" in message]


def test_an_encoder_on_the_motor(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The angle that it reads is not the fin's."""
    path, text = tmp_path / "mine.py", (FOLDER / "strain_wave.py").read_text(encoding="utf-8")
    path.write_text(text.replace('_angle": angle', '_angle": x.motor_angle'), encoding="utf-8")
    simulate(load_parameters(model=str(path)).values, 0.002, kernel="python", model=str(path))
    (message,) = caplog.messages
    assert re.search("measured_fin_angle is 199[78] deg where fin_angle is 19.97 deg", message)


@pytest.mark.parametrize(("before", "after", "name"), [
    ("now + start.encoder_offset", "now", "initial"),
    ("now + inputs.encoder_offset", "now - inputs.encoder_offset", "sample"),
])
def test_an_encoder_without_offset(tmp_path: Path, before: str, after: str, name: str) -> None:
    """It is refused where homing shifts it; without homing nothing depends on it."""
    geared = Path(__file__).with_name("geared.py")
    path, text = tmp_path / "mine.py", geared.read_text(encoding="utf-8")
    assert before in text
    path.write_text(text.replace(before, after), encoding="utf-8")
    copy(geared.with_suffix(".toml"), path.with_suffix(".toml"))
    simulate(load_parameters(model=str(path)).values, 0.002, kernel="python", model=str(path))
    with pytest.raises(EmcasError, match=rf"mine\.py, line \d+: {name}\(\) returns counts that an encoder_offset of 1"):
        simulate(load_parameters(model=f"{path}+homing").values, 0.002, kernel="python", model=f"{path}+homing")


# Those of which a warning speaks: limit, power, measured angle. Power in motion is judged without extensions only.
SPOKEN_OF = ("", "+efficiency", "+homing", "+saturation", "+sensors", "+supply")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where an actuator has one file for all extensions: without them it is traced once."""
    return tmp_path_factory.mktemp("sound")


@pytest.mark.parametrize(("name", "extension"), others_slow(
    [(name, extension) for name in NAMES for extension in ("", *(
        f"+{each}" for each in EXTENSIONS if get(name).provides.issuperset(get_extension(each).needs)))
     if name == "nonlinear" or extension in SPOKEN_OF],
    lambda case: case[0] == "nonlinear" and case[1] in SPOKEN_OF))
def test_a_sound_actuator_says_nothing(folder: Path, caplog: pytest.LogCaptureFixture, name: str,
                                       extension: str) -> None:
    """The shipped ones, as if they were a user's; their other warnings are true.

    The default one, which takes every extension, has each; the others have those of which a warning speaks.
    """
    path = folder / f"{name}.py"
    path.write_text("from dataclasses import replace\n\nfrom emcas_fmu.actuators import get\n\n"
                    f'ACTUATOR = replace(get("{name}"), name="mine")\n', encoding="utf-8")
    simulate(load_parameters(model=f"{name}{extension}").values, 0.002, kernel="python", model=f"{path}{extension}")
    assert [message for message in caplog.messages
            if re.search("limited|measured_fin_angle|supply_power|saturated", message)] == []
