"""The Python interface: the names that a user imports from `emcas_fmu`."""

from __future__ import annotations

import re
import subprocess
import sys
import warnings
from math import radians
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest

import emcas_fmu
from emcas_fmu import (
    EmcasError,
    ParameterSet,
    analyse,
    build,
    excitations,
    fin_sets,
    load_parameters,
    simulate,
    tune,
    validate,
)
from emcas_fmu.bench import metrics
from emcas_fmu.simulation import simulate as simulate_kernel

BASE = load_parameters()


def test_public_names_exist_and_are_documented() -> None:
    for name in emcas_fmu.__all__:
        assert getattr(emcas_fmu, name).__doc__, name
    assert set(emcas_fmu.__all__) <= set(dir(emcas_fmu))
    with pytest.raises(AttributeError, match="no attribute 'simulat'"):
        _ = emcas_fmu.simulat


def test_import_loads_no_library() -> None:
    code = "import sys, emcas_fmu; assert not {'numpy', 'pydantic', 'matplotlib'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("command", [0.1, "0.1 rad", lambda t: 0.1, np.full(101, 0.1), [0.1] * 101],
                         ids=["number", "text", "function", "array", "list"])
def test_every_form_of_an_input_gives_the_outputs_of_the_kernel(command: float | str) -> None:
    response = simulate(BASE, fin_command=command, stop="100 ms")
    expected = simulate_kernel(BASE.values, 0.1, fin_command=0.1)
    for name, column in expected.items():
        assert np.array_equal(response[name], column)
    assert np.array_equal(response["fin_command"], np.full(101, 0.1))


def test_excitation_with_further_inputs() -> None:
    excitation = excitations.step_to(radians(10.0), 0.2)
    response = simulate(excitation=excitation, aero_torque="-50 N*m", attitude__roll="30 deg")
    assert response["aero_torque"][-1] == -50.0
    assert response.excitation.columns["attitude.roll"][0] == pytest.approx(radians(30.0), abs=1e-15)
    assert {type(value) for value in response.metrics().values()} == {float}  # not NumPy's, which print differently
    assert response.metrics()["overshoot_percent"] < 5.0  # Table 2's requirement
    assert response.time[-1] == excitation.stop


def test_start_values_of_an_excitation() -> None:
    """The start values of a reference case, which turn the encoder off, become parameters of the run."""
    response = simulate(excitation=excitations.reference_case("step_plus1"))
    (used,) = response.sets
    changed = {name for name, value in used.values.items() if value != BASE.values[name]}
    assert changed
    assert changed <= set(response.excitation.start_values)


@pytest.mark.parametrize(("call", "message"), [
    (lambda: simulate(fin_comand=0.1), "no input fin_comand; did you mean fin_command?"),
    (lambda: simulate(fin_command="10 deg/s"), "fin_command.*expected a number with a unit such as rad"),
    (lambda: simulate(fin_command=[1.0, 2.0]), "array of 501 values"),
    (lambda: simulate(fin_command=float("nan")), "fin_command is nan"), (lambda: simulate(stop=0.0), "must be above 0"),
    (lambda: simulate(stop="1 kg"), "expected a number with a unit such as s"),
    (lambda: simulate([]), "pass one parameter set"),
    (lambda: simulate([BASE, load_parameters(model="linear")]), "of one actuator"),
    (lambda: simulate(BASE, excitations.step_to(0.1, 0.1), stop=1.0), "are set by the excitation"),
    (lambda: simulate(BASE, kernel="fast"), "kernel fast"),
    (lambda: simulate(fin_sets(BASE, 2), line={"bus.resistance": 1.0}), "bus.resistance"),
    (lambda: simulate(BASE, line={"bus.source_resistance": 0.1}), "several fins"),
    (lambda: simulate("my.toml"), r"parameters = 'my.toml': expected a parameter set \(load_parameters\(\)"),  # type: ignore[arg-type]
    (lambda: analyse("my.toml"), "expected a parameter set"),  # type: ignore[arg-type]
    (lambda: build("my.toml", "my.fmu"), "^build: parameters = 'my.toml': expected a par"),  # type: ignore[arg-type]
    (lambda: fin_sets("my.toml", 4), "^fin_sets: base = 'my.toml': expected a par"),  # type: ignore[arg-type]
    (lambda: simulate(BASE, "step_plus10"), "excitations.reference_case"),  # type: ignore[arg-type]
    (lambda: validate(BASE, cases="nonsense"), "no case nonsense|nonsense"),
    (lambda: tune(study="missing.toml"), "missing.toml"),
    (lambda: validate("EMCAS.zip"), "neither an FMU nor a parameter file"),
    (lambda: BASE.with_values({"motor.kp": 1.0}), "no such parameter"),
])
def test_wrong_arguments_are_refused(call: object, message: str) -> None:
    with pytest.raises(EmcasError, match=message):
        call()  # type: ignore[operator]


def test_with_values_returns_a_changed_copy() -> None:
    """The text of a value is as in a file."""
    changed = BASE.with_values({"kinematics.moment_arm": "42 mm", "controller.position.kp": 70.0})
    assert isinstance(changed, ParameterSet)
    assert changed.values["kinematics.moment_arm"] == 0.042
    assert BASE.values["kinematics.moment_arm"] != 0.042


def test_four_fins_share_a_bus() -> None:
    """The bus sags, and the commands are mixed; outputs have the names of an FMU of four fins."""
    response = simulate(fin_sets(BASE, 4), stop=0.05, line={"bus.source_resistance": 0.05}, pitch_command="5 deg",
                        **{"fin[2].fin_command": "1 deg"})  # type: ignore[arg-type]  # one of the inputs
    assert response["fin[1].fin_angle"][-1] != response["fin[2].fin_angle"][-1]
    assert response["bus_voltage"].min() < 39.0
    assert response.metrics(fin=1)["peak_current_a"] > 0.0


@pytest.mark.parametrize(("command", "warning"), [
    ("20 deg", ()), ("25 deg", ("is clipped$",)), (10.0, ("573 deg.*is it in degrees",))])
def test_simulate_issues_the_warnings_of_the_response(command: float | str, warning: tuple[str, ...]) -> None:
    """The warnings have the caller's file."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        listed = simulate(stop=0.01, fin_command=command).warnings
    assert [str(each.message) for each in caught] == list(listed)
    assert {each.filename for each in caught} <= {__file__}
    assert all(re.search(pattern, text) for pattern, text in zip(warning, listed, strict=True))


def test_response_is_read_written_and_plotted(tmp_path: Path) -> None:
    response = simulate(BASE, excitations.step_to(radians(5.0), 0.1))
    assert response.units["fin_angle"] == "rad"
    assert response.units["saturated"] == ""
    assert response.in_unit("fin_angle", "deg")[-1] == pytest.approx(np.degrees(response["fin_angle"][-1]), abs=1e-12)
    with pytest.raises(EmcasError, match="no fin_angel; did you mean fin_angle"):
        _ = response["fin_angel"]
    with pytest.raises(EmcasError, match=r"fin_angle.*does not measure"):
        response.in_unit("fin_angle", "kg")
    with pytest.raises(EmcasError, match="the unit V does not measure it; it is in rad"):
        response.in_unit("fin_angle", "V")
    with pytest.raises(EmcasError, match="no fin 5"):
        response.metrics(5)
    with pytest.raises(EmcasError, match="cannot be written"):
        response.write_csv(tmp_path / "none" / "r.csv")
    response.write_csv(tmp_path / "r.csv")
    header = (tmp_path / "r.csv").read_text(encoding="utf-8").splitlines()[0].split(",")
    rows = np.loadtxt(tmp_path / "r.csv", delimiter=",", skiprows=1)
    assert np.array_equal(rows[:, header.index("fin_angle")], response["fin_angle"])
    assert response.plot(tmp_path / "r.png").axes
    assert (tmp_path / "r.png").stat().st_size > 1000
    with pytest.raises(EmcasError, match="gif"):
        response.plot(tmp_path / "r.gif")
    assert "fin_angle_final_deg" in response._repr_html_()


def test_figures_are_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The caller may change a returned dictionary without effect on later results."""
    usage = Mock(side_effect=metrics.usage_figures)
    monkeypatch.setattr(metrics, "usage_figures", usage)
    response = simulate(fin_sets(BASE, 2), stop=0.01)
    shown = response.as_dict(), response.lines()
    figures = response.metrics(1)
    assert figures == response.as_dict()["fins"][1]
    for returned in (figures, response.as_dict()["fins"][1], response.as_dict()["bus"]):
        returned.clear()
    assert (response.as_dict(), response.lines()) == shown
    assert usage.call_count == 3  # once for each fin, and once for the bus


def test_dataframe_contains_the_response() -> None:
    pytest.importorskip("pandas")
    response = simulate(stop=0.01)
    frame = response.to_dataframe()
    assert frame.index.name == "time"
    assert frame.attrs["units"]["fin_rate"] == "rad/s"
    assert np.array_equal(frame["fin_angle"].to_numpy(), response["fin_angle"])


def test_dataframe_without_pandas_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(EmcasError, match=r"^to_dataframe\(\) needs .* pandas, .*: pip install pandas$"):
        simulate(stop=0.01).to_dataframe()


@pytest.mark.slow
def test_validate_and_analyse() -> None:
    assert validate(BASE, cases=["step_plus1"]).passed
    analysis = analyse(BASE, fin_angle="5 deg")
    assert 10.0 < analysis.linear.command.bandwidth < 30.0  # Hz: Table 2's minimum, and the maximum of the sampled loop
