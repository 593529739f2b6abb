"""`emcas analyse`: its files and errors; rod modes and capability, which need no simulation."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from math import degrees, pi, radians
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.errors import EmcasError
from emcas_fmu.simulation import simulate
from emcas_fmu.studies.analysis.capability import capability, envelope
from emcas_fmu.studies.analysis.modes import load_rod, modes, modes_at, thesis_modes
from tests.commands import emcas

Values = Mapping[str, Any]


@pytest.fixture(scope="module")
def analysis(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], str, str]:
    """JSON, page and terminal output of one run at 6 deg with a load."""
    folder = tmp_path_factory.mktemp("analysis")
    result = emcas("analyse", "--at", "6", "--torque", "-20", "--locus", "controller.velocity.kp",
                   "--json", str(folder / "a.json"), "--report", str(folder / "a.html"))
    assert result.exit_code == 0, result.output
    page = (folder / "a.html").read_text(encoding="utf-8")
    return json.loads((folder / "a.json").read_text(encoding="utf-8")), page, result.output


@pytest.mark.slow
def test_json_has_the_documented_keys(analysis: tuple[dict[str, Any], str, str]) -> None:
    found, _, _ = analysis
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
    # The stored transfer function has the stored bandwidth.
    t = linear["transfer_function"]
    z = np.exp(2j * pi * linear["bandwidth_3db_hz"] * t["sample_time_s"])
    gain = np.array(t["C"]) @ np.linalg.solve(z * np.eye(len(t["A"])) - np.array(t["A"]), np.array(t["B"])[:, :1])
    assert abs(gain[0, 0]) == pytest.approx(10.0 ** (-3.0 / 20.0), rel=1e-4)  # interpolated: 500 points per decade


@pytest.mark.slow
def test_page_has_all_sections_and_loads_no_other_file(analysis: tuple[dict[str, Any], str, str]) -> None:
    _, page, _ = analysis
    titles = ("Bode diagrams", "Nichols chart", "Root locus against controller.velocity.kp",
              "Steps, linear and simulated", "Bandwidth against amplitude", "Where the limits act", "Torque and speed",
              "Capability against fin angle", "Final values", "Natural frequencies", "Stability margins")
    assert [title for title in titles if title not in page] == []
    assert page.count("<svg") == 8
    assert "Padé" in page
    assert not re.search(r'(?:src|href)="(?!#|data:)', page)
    assert "nan" not in re.sub(r"<svg.*?</svg>", "", page, flags=re.DOTALL)


@pytest.mark.slow
def test_output_reports_the_mistake_in_the_thesis(analysis: tuple[dict[str, Any], str, str]) -> None:
    assert "divides rad/s by Hz; the correct factors are 6.7 and 22.2" in analysis[2]


def test_help_has_examples() -> None:
    result = emcas("analyse", "--help")
    assert result.exit_code == 0
    assert "emcas analyse" in result.output


@pytest.mark.parametrize(("arguments", "message"), [
    (["--at", "21"], "±20 deg"), (["--at", "nan"], "finite"), (["--torque", "2000"], "drive.current_limit"),
    (["--locus", "controller.position.kq"], "controller.position.kp"), (["--rod", "none.toml"], "none.toml"),
    (["--parameters", "none.toml"], "none.toml"),
])
def test_error_names_the_option_and_the_remedy(arguments: list[str], message: str) -> None:
    result = emcas("analyse", *arguments)
    assert result.exit_code == 2
    assert message in result.stderr.replace("\n", "")
    assert "Traceback" not in result.stderr


def test_unstable_loop_is_refused(tmp_path: Path) -> None:
    file = tmp_path / "fast.toml"
    file.write_text('[controller]\nvelocity.kp = "0.5 V*s/rad"\n', encoding="utf-8")
    result = emcas("analyse", "-p", str(file))
    assert result.exit_code == 2
    assert "unstable" in result.stderr
    assert "controller.velocity.kp" in result.stderr.replace("\n", "")


def test_modes_of_the_rod_agree_with_table_1() -> None:
    found = thesis_modes()
    # By hand from Table 1: sqrt(8.528e7/476) and sqrt(584.8/3e-4), rounded.
    assert 2.0 * pi * found["axial_hz"] == pytest.approx(423.3, abs=0.1)
    assert 2.0 * pi * found["torsional_hz"] == pytest.approx(1396.0, abs=0.5)
    # The thesis's factors "42 to 139" are rad/s divided by Hz, truncated.
    assert [int(found[f"{name}_rad_per_s_over_hz"]) for name in ("axial", "torsional")] == [42, 139]
    assert [found[f"{name}_over_bandwidth"] for name in ("axial", "torsional")] == pytest.approx([6.74, 22.2], abs=0.03)


def test_modes_have_the_inertia_of_the_parameters(values: Values) -> None:
    rod = load_rod()
    doubled = {name: 2.0 * value if name.startswith("inertia.") or name == "mass.nut" else value
               for name, value in values.items()}
    own, heavy = modes_at(rod, values, 0.1), modes_at(rod, doubled, 0.1)
    assert own["axial_hz"] / heavy["axial_hz"] == pytest.approx(2.0**0.5)
    assert own["torsional_hz"] / heavy["torsional_hz"] == pytest.approx(2.0**0.5)
    assert own["mass_kg"] == pytest.approx(own["inertia_kgm2"] / values["screw.lead"] ** 2)


def test_rod_file_may_use_other_units(tmp_path: Path) -> None:
    file = tmp_path / "rod.toml"
    file.write_text('[rod]\ndiameter = "2.4 cm"\nlength = { value = 557, unit = "mm", source = "drawing" }\n',
                    encoding="utf-8")
    thick, thin = modes(load_rod(file), 1.0, 1.0), modes(load_rod(), 1.0, 1.0)
    assert thick["axial_hz"] / thin["axial_hz"] == pytest.approx((4.0 / 2.0) ** 0.5)  # area over length
    assert thick["torsional_hz"] / thin["torsional_hz"] == pytest.approx((16.0 / 2.0) ** 0.5)


@pytest.mark.parametrize(("text", "message"), [
    ('[rod]\nlenght = "1 m"\n', "rod.lenght = 1 m: a rod has no such entry; did you mean rod.length"),
    ('[rod]\nlength = "1 kg"\n', "expected a number with a unit such as m"),
    ('[rod]\nlength = "-1 m"\n', "must be within 1e-15 .. inf m"), ("[rod", "is not valid TOML"),
    ("rod = 3\n", "rod = 3: is a group of parameters; expected a table such as rod.length"),
    ('[rod]\nlength = { value = 1, unti = "m" }\n', "an entry has")])
def test_error_names_the_entry_of_a_rod_file(tmp_path: Path, text: str, message: str) -> None:
    file = tmp_path / "rod.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(EmcasError, match=message):
        load_rod(file)


def test_torque_envelope_has_the_limits_of_current_and_voltage(values: Values) -> None:
    e = envelope(values)
    speed, highest, free = e["speed_rad_per_s"], e["torque_nm"], e["no_load_speed_rad_per_s"]
    volts, ohms, amps = values["drive.supply_voltage"], values["motor.resistance"], values["drive.current_limit"]
    assert e["stall_torque_nm"] == pytest.approx(values["motor.torque_constant"] * min(amps, volts / ohms))
    corner = (volts - ohms * amps) / values["motor.back_emf_constant"]
    below, above = np.interp([0.9 * corner, 0.5 * (corner + free)], speed, highest)
    assert below == pytest.approx(e["stall_torque_nm"])
    # The limit is a straight line to the no-load speed, interpolated between 404 points.
    assert above == pytest.approx(0.5 * e["stall_torque_nm"], rel=0.01)
    assert np.all(e["prompt_torque_nm"] <= highest)


def test_rate_capability_is_the_speed_limit_divided_by_the_ratio(values: Values) -> None:
    found = capability(values)
    # Where the supply allows more than the controllers, the rate is the speed limit divided by the ratio.
    limited = found.free_rate > found.rate * (1.0 + 1e-9)
    assert np.any(limited)
    expected = np.broadcast_to(values["controller.speed_limit"] / found.ratio, found.rate.shape)
    np.testing.assert_allclose(found.rate[limited], expected[limited], rtol=1e-12)
    assert np.all(found.free_rate_loaded < found.free_rate)
    assert np.all(found.held > found.stall)


def test_fin_stops_at_the_stall_torque(values: Values) -> None:
    # The fin follows a command against 97 % of the stall torque, not against 103 %. Without integral the drive's
    # current is below its reference, which is why its gain is high here.
    p = {**values, "drive.kp": 500.0, "encoder.enabled": False, "fin.start_angle": 0.0}
    found = capability(p)
    stall = float(np.interp(0.0, found.fin_angle, found.stall[0]))
    ends = [float(simulate(p, 0.3, fin_command=radians(15.0), aero_torque=-factor * stall)["fin_angle"][-1])
            for factor in (0.97, 1.03)]
    assert degrees(ends[0]) > 1.0
    assert degrees(ends[1]) <= 0.0
