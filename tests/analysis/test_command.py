"""The command, its files, and the findings that need no time domain."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from math import degrees, pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from emcas_fmu.cli import app
from emcas_fmu.errors import EmcasError
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis.capability import capability, envelope
from emcas_fmu.studies.analysis.modes import load_rod, modes, modes_at, thesis_modes

Values = Mapping[str, Any]


def emcas(*arguments: str) -> Result:
    return CliRunner().invoke(app, list(arguments))


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], str, str]:
    """JSON, page and output of one run of the command, away from the middle and under load."""
    folder = tmp_path_factory.mktemp("analysis")
    done = emcas("analyse", "--at", "6", "--torque", "-20", "--locus", "controller.velocity.kp",
                 "--json", str(folder / "a.json"), "--report", str(folder / "a.html"))
    assert done.exit_code == 0, done.output
    page = (folder / "a.html").read_text(encoding="utf-8")
    return json.loads((folder / "a.json").read_text(encoding="utf-8")), page, done.output


@pytest.mark.slow
def test_json_has_the_keys_promised(written: tuple[dict[str, Any], str, str]) -> None:
    found, _, _ = written
    linear = found["linear"]
    for key in ("bandwidth_3db_hz", "bandwidth_90deg_hz", "gain_margin_db", "phase_margin_deg", "delay_margin_s"):
        assert linear[key] > 0.0
        assert found["thesis_linear"][key] > 0.0
    assert {key: linear[key] for key in linear["loops"]["reference"] if key in linear} == {
        key: value for key, value in linear["loops"]["reference"].items() if key in linear}
    assert set(linear["loops"]) == {"current", "velocity", "position", "reference"}
    assert linear["loops"]["current"]["gain_margin_db"] is None  # a first-order loop: unlimited
    assert found["modes"]["axial_hz"] == pytest.approx(67.4, abs=0.5)
    assert found["modes"]["torsional_hz"] == pytest.approx(222.0, abs=2.0)
    assert set(found["final_values"]) >= {"p", "pi"}
    assert found["operating_point"]["fin_angle_deg"] == pytest.approx(6.0)
    assert [step["step_deg"] for step in found["steps"]] == [1.0, 3.0, 10.0, -20.0]
    # The transfer function in the file is the one the figures are of.
    t = linear["transfer_function"]
    z = np.exp(2j * pi * linear["bandwidth_3db_hz"] * t["sample_time_s"])
    gain = np.array(t["C"]) @ np.linalg.solve(z * np.eye(len(t["A"])) - np.array(t["A"]), np.array(t["B"])[:, :1])
    assert abs(gain[0, 0]) == pytest.approx(10.0 ** (-3.0 / 20.0), rel=1e-4)  # read between 500 points a decade


@pytest.mark.slow
def test_page_is_whole_and_by_itself(written: tuple[dict[str, Any], str, str]) -> None:
    _, page, _ = written
    titles = ("Bode diagrams", "Nichols chart", "Root locus against controller.velocity.kp",
              "Steps, linear and simulated", "Bandwidth against amplitude", "Where the limits act", "Torque and speed",
              "Capability against fin angle", "Final values", "Natural frequencies", "Stability margins")
    assert [title for title in titles if title not in page] == []
    assert page.count("<svg") == 8
    assert "Padé" in page
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)


@pytest.mark.slow
def test_output_points_out_the_unit_slip(written: tuple[dict[str, Any], str, str]) -> None:
    assert "divides rad/s by Hz; the correct factors are 6.7 and 22.2" in written[2]


def test_help_has_examples() -> None:
    done = emcas("analyse", "--help")
    assert done.exit_code == 0
    assert "emcas analyse" in done.output


@pytest.mark.parametrize(("arguments", "says"), [
    (["--at", "21"], "±20 deg"), (["--at", "nan"], "finite"), (["--torque", "2000"], "drive.current_limit"),
    (["--locus", "controller.position.kq"], "controller.position.kp"), (["--rod", "none.toml"], "none.toml"),
    (["--parameters", "none.toml"], "none.toml"),
])
def test_refusals_name_thing_and_remedy(arguments: list[str], says: str) -> None:
    done = emcas("analyse", *arguments)
    assert done.exit_code == 2
    assert says in done.stderr.replace("\n", "")
    assert "Traceback" not in done.stderr


def test_an_unstable_loop_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "fast.toml"
    file.write_text('[controller]\nvelocity.kp = "0.5 V*s/rad"\n', encoding="utf-8")
    done = emcas("analyse", "-p", str(file))
    assert done.exit_code == 2
    assert "unstable" in done.stderr
    assert "controller.velocity.kp" in done.stderr.replace("\n", "")


def test_modes_are_those_of_table_1() -> None:
    found = thesis_modes()
    # Computed by hand from Table 1: sqrt(8.528e7/476) and sqrt(584.8/3e-4), to the digits written.
    assert 2.0 * pi * found["axial_hz"] == pytest.approx(423.3, abs=0.1)
    assert 2.0 * pi * found["torsional_hz"] == pytest.approx(1396.0, abs=0.5)
    # The thesis's figures "42 to 139" come out of rad/s over Hz, cut to whole numbers.
    assert [int(found[f"{name}_rad_per_s_over_hz"]) for name in ("axial", "torsional")] == [42, 139]
    assert [found[f"{name}_over_bandwidth"] for name in ("axial", "torsional")] == pytest.approx([6.74, 22.2], abs=0.03)


def test_modes_take_the_inertia_of_the_parameters(values: Values) -> None:
    rod = load_rod()
    doubled = {name: 2.0 * value if name.startswith("inertia.") or name == "mass.nut" else value
               for name, value in values.items()}
    own, heavy = modes_at(rod, values, 0.1), modes_at(rod, doubled, 0.1)
    assert own["axial_hz"] / heavy["axial_hz"] == pytest.approx(2.0**0.5)
    assert own["torsional_hz"] / heavy["torsional_hz"] == pytest.approx(2.0**0.5)
    assert own["mass_kg"] == pytest.approx(own["inertia_kgm2"] / values["screw.lead"] ** 2)


def test_rod_file_overrides_in_its_own_units(tmp_path: Path) -> None:
    file = tmp_path / "rod.toml"
    file.write_text('[rod]\ndiameter = "2.4 cm"\nlength = { value = 557, unit = "mm", source = "drawing" }\n',
                    encoding="utf-8")
    thick, thin = modes(load_rod(file), 1.0, 1.0), modes(load_rod(), 1.0, 1.0)
    assert thick["axial_hz"] / thin["axial_hz"] == pytest.approx((4.0 / 2.0) ** 0.5)  # area over length
    assert thick["torsional_hz"] / thin["torsional_hz"] == pytest.approx((16.0 / 2.0) ** 0.5)


@pytest.mark.parametrize(("text", "says"), [
    ('[rod]\nlenght = "1 m"\n', "rod.lenght = 1 m: a rod has no such entry; did you mean rod.length"),
    ('[rod]\nlength = "1 kg"\n', "expected a number with a unit such as m"),
    ('[rod]\nlength = "-1 m"\n', "must be within 1e-15 .. inf m"), ("[rod", "is not valid TOML"),
    ("rod = 3\n", "rod = 3: is a group of parameters; expected a table such as rod.length"),
    ('[rod]\nlength = { value = 1, unti = "m" }\n', "an entry has")])
def test_bad_rod_files_are_refused(tmp_path: Path, text: str, says: str) -> None:
    file = tmp_path / "rod.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(EmcasError, match=says):
        load_rod(file)


def test_envelope_has_the_corners_of_current_and_voltage(values: Values) -> None:
    e = envelope(values)
    speed, highest, free = e["speed_rad_per_s"], e["torque_nm"], e["no_load_speed_rad_per_s"]
    volts, ohms, amps = values["drive.supply_voltage"], values["motor.resistance"], values["drive.current_limit"]
    assert e["stall_torque_nm"] == pytest.approx(values["motor.torque_constant"] * min(amps, volts / ohms))
    corner = (volts - ohms * amps) / values["motor.back_emf_constant"]
    below, above = np.interp([0.9 * corner, 0.5 * (corner + free)], speed, highest)
    assert below == pytest.approx(e["stall_torque_nm"])
    # Straight to the no-load speed, between 404 points.
    assert above == pytest.approx(0.5 * e["stall_torque_nm"], rel=0.01)
    assert np.all(e["prompt_torque_nm"] <= highest)


def test_capability_follows_the_ratio(values: Values) -> None:
    found = capability(values)
    # Rates at the controllers' limit, the supply allowing more: exactly one over the ratio.
    limited = found.free_rate > found.rate * (1.0 + 1e-9)
    assert np.any(limited)
    expected = np.broadcast_to(values["controller.speed_limit"] / found.ratio, found.rate.shape)
    np.testing.assert_allclose(found.rate[limited], expected[limited], rtol=1e-12)
    assert np.all(found.free_rate_loaded < found.free_rate)
    assert np.all(found.held > found.stall)


def test_stall_is_where_the_model_stops_moving(values: Values) -> None:
    # 3 % below the stall moment the fin follows a far command, 3 % above it does not: the drive's proportional
    # control alone leaves some of the current off, so its gain is raised here; no integral takes 50 s then.
    p = {**values, "drive.kp": 500.0, "encoder.enabled": False, "fin.start_angle": 0.0}
    found = capability(p)
    stall = float(np.interp(0.0, found.fin_angle, found.stall[0]))
    ends = [float(simulate(p, 0.3, fin_command=radians(15.0), aero_torque=-factor * stall)["fin_angle"][-1])
            for factor in (0.97, 1.03)]
    assert degrees(ends[0]) > 1.0
    assert degrees(ends[1]) <= 0.0
