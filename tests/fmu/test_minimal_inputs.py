"""FMUs with `--inputs minimal`: only command and load are inputs."""

from __future__ import annotations

from collections.abc import Mapping
from math import nan
from pathlib import Path
from typing import Any

import fmpy
import pytest
from fmpy.validation import validate_fmu

from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters

from .built import lean, unpacked
from .host import DISCARD, ERROR, OK, Instance

pytestmark = pytest.mark.fmu


@pytest.mark.parametrize(("fmi", "fins"), [("2", 1), pytest.param("3", 4, marks=pytest.mark.slow)])
def test_the_other_inputs_are_tunable_parameters(tmp_path: Path, fmi: str, fins: int) -> None:
    """Start values and results have the bits of an FMU with all inputs."""
    full, minimal = (lean(load_parameters(), tmp_path / f"{inputs}.fmu", fmi=fmi, fins=fins, inputs=inputs)
                     for inputs in ("all", "minimal"))
    assert validate_fmu(str(minimal)) == []
    before, after = ({v.name: v for v in fmpy.read_model_description(str(path)).modelVariables}
                     for path in (full, minimal))
    inputs = {name for name, v in after.items() if v.causality == "input"}
    assert {name.rpartition(".")[2] for name in inputs} == {"fin_command", "aero_torque"}
    others = [v for name, v in after.items() if before[name].causality == "input" and name not in inputs]
    assert len(others) > 10
    assert {(v.causality, v.variability) for v in others} == {("parameter", "tunable")}
    assert {name: v.start for name, v in before.items()} == {name: v.start for name, v in after.items()}
    command = {name: 0.2 if fins == 1 else [0.2] * fins for name in inputs if name.endswith("fin_command")}
    runs = [fmpy.simulate_fmu(str(path), stop_time=0.1, output_interval=1e-3, start_values=command)
            for path in (full, minimal)]
    assert runs[0].tobytes() == runs[1].tobytes()


def test_only_inputs_have_derivatives(tmp_path: Path) -> None:
    unit = Instance(unpacked(lean(load_parameters(), tmp_path / "x.fmu", inputs="minimal"), tmp_path))
    assert max(unit.initialize()) == OK
    assert unit.differentiate("aero_torque", 1, 1.0) == OK
    assert unit.differentiate("supply_voltage", 1, 1.0) == ERROR


@pytest.mark.parametrize(("backend", "refused"), [("native", ERROR), ("python", DISCARD)])
def test_the_other_inputs_have_limits_as_parameters(tmp_path: Path, backend: str, refused: int) -> None:
    fmu = unpacked(lean(load_parameters(), tmp_path / "x.fmu", backend, inputs="minimal"), tmp_path)
    for name, bad, message in (("supply_voltage", -5.0, "supply_voltage = -5 is below its minimum 0"),
                               ("acceleration.x", nan, "acceleration.x = nan is not a finite number")):
        unit, clean = Instance(fmu), Instance(fmu)
        assert max(*unit.initialize(), *clean.initialize()) == OK
        good = unit.get(name)
        assert max(unit.set(name, bad), unit.step(0.0, 1e-3)) == refused
        assert message in unit.log[0][1]
        time = 1e-3 if backend == "native" else 0.0  # a native FMU refuses the call, the Python FMU the step
        assert unit.set(name, good) == OK
        assert {unit.run(time, 0.02, 1e-3), clean.run(0.0, 0.02, 1e-3)} == {OK}
        assert unit.outputs() == clean.outputs()
        before = Instance(fmu)
        assert max(*before.initialize(**{name.replace(".", "__"): bad}), before.step(0.0, 1e-3)) == refused
        assert message in before.log[0][1]


@pytest.mark.parametrize(("options", "message"), [
    ({"inputs": "minimal", "part": "plant"}, "part plant has the signals"),
    ({"inputs": "few"}, "inputs few: choose all or minimal")])
def test_minimal_inputs_of_a_half_and_unknown_names_are_refused(tmp_path: Path, options: Mapping[str, Any],
                                                                message: str) -> None:
    with pytest.raises(EmcasError, match=message):
        build(load_parameters(), tmp_path / "x.fmu", **options)
