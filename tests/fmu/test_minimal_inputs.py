"""An FMU whose inputs are command and load alone."""

from __future__ import annotations

import ctypes as ct
import zipfile
from pathlib import Path

import fmpy
import pytest
from fmpy.validation import validate_fmu

from emcas_fmu.errors import EmcasError
from emcas_fmu.fmi.package import build
from emcas_fmu.parameters import load_parameters

from .built import lean
from .host import ERROR, OK, Fmu, Instance

pytestmark = pytest.mark.fmu


@pytest.mark.parametrize(("fmi", "fins"), [("2", 1), pytest.param("3", 4, marks=pytest.mark.slow)])
def test_the_other_inputs_are_tunable_parameters(tmp_path: Path, fmi: str, fins: int) -> None:
    """With the start values and, through a run, the bits of the ordinary unit."""
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
    with zipfile.ZipFile(lean(load_parameters(), tmp_path / "x.fmu", inputs="minimal")) as archive:
        archive.extractall(tmp_path)
    unit = Instance(Fmu(str(tmp_path)))
    assert max(unit.initialize()) == OK
    for name, status in (("aero_torque", OK), ("supply_voltage", ERROR)):
        reference = (ct.c_uint * 1)(unit.fmu.references[name])
        assert unit.call("SetRealInputDerivatives", reference, ct.c_size_t(1), (ct.c_int * 1)(1),
                         (ct.c_double * 1)(1.0)) == status


def test_a_part_has_its_inputs(tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match="part plant has the signals"):
        build(load_parameters(), tmp_path / "x.fmu", inputs="minimal", part="plant")


def test_there_is_all_and_minimal(tmp_path: Path) -> None:
    with pytest.raises(EmcasError, match="inputs few: choose all or minimal"):
        build(load_parameters(), tmp_path / "x.fmu", inputs="few")
