"""Archives of actuators that have no supply, no screw, or are a user's: written, checked, and run in fmpy."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import get
from emcas_fmu.bench.excitation import step_to
from emcas_fmu.fmi.interface import require_shared
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate, simulate_fins
from emcas_fmu.ssp.archive import NOMINAL, read_archive
from emcas_fmu.ssp.structure import read_variant
from emcas_fmu.ssp.variants import Variant, derived, variant_files
from emcas_fmu.ssp.write import write_ssp
from examples.ssp_hosts import hosts
from tests.fmu.built import lean
from tests.own_actuator.example import changed

from .conftest import emcas, valid_documents

pytestmark = pytest.mark.fmu
DIRECT_DRIVE = str(Path(__file__).parents[2] / "examples/own_actuator/direct_drive.py")
# A moment on the hinge as an input of each fin's own; its start value is in the parameter file.
PRELOADED = (
    ("MOTOR_CURRENT = ", 'PRELOAD = em.real_input("preload", "N.m", "moment of the spring at 0", start=None, '
                         'key="spring.preload")\nMOTOR_CURRENT = '),
    ("    supply=em.", "    further_inputs=(PRELOAD,),\n    supply=em."),
    ("- p.spring.stiffness * x.fin_angle", "+ u.preload - p.spring.stiffness * x.fin_angle"),
)
# The FMU and the kernel in this process compute the same bits; a host's clock is within 1e-15 s (test_hosts.py).
SAME = 1e-9


@pytest.fixture(scope="module", params=["second-order", DIRECT_DRIVE, "preloaded"])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    """An actuator; the last one has an input of its own that starts at a value of the parameter file."""
    if request.param != "preloaded":
        return str(request.param)
    path = changed(tmp_path_factory.mktemp("preloaded"), *PRELOADED)
    path.with_suffix(".toml").write_text('spring.preload = "30 N*m"\n', encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def written(model: str, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str]:
    """Its archive, of a native FMU for this platform and a second fin of its own, and what was printed."""
    folder = tmp_path_factory.mktemp("actuator")
    unit = lean(load_parameters(model=model), folder / "unit.fmu")
    own = 'spring.preload = "10 N*m"\n' if get(model).further_inputs else ""
    (folder / "second.toml").write_text(f'{own}[fin]\nstart_angle = "3 deg"\n', encoding="utf-8")
    asked = ("--model", model) if model.endswith(".py") else ()
    return folder / "a.ssp", emcas("--fmu", unit, "-o", folder / "a.ssp", "--fin", f"2={folder / 'second.toml'}",
                                   *asked)


def test_variants_it_has_no_parameters_for_are_left_out(model: str, written: tuple[Path, str]) -> None:
    path, printed = written
    assert "left out: variant cold: this actuator has no friction.temperature" in printed
    assert "left out: variant degraded: this actuator has no" in printed
    assert "variants nominal (SystemStructure.ssd); schema and wiring checked" in printed
    said = emcas("check", path, *(("--model", model) if model.endswith(".py") else ()))
    assert said.startswith("passed, 0 warnings")


def test_files_are_valid_and_inputs_those_of_the_actuator(model: str, written: tuple[Path, str]) -> None:
    assert valid_documents(written[0])
    archive = read_archive(written[0])
    assert (b"supply_voltage" in archive["SystemStructure.ssd"]) is (get(model).supply is not None)
    fin = archive["resources/nominal_fin2.ssv"]
    assert (b"supply_voltage" in fin) is (get(model).supply is not None)
    assert all(f'"{v.name}"'.encode() in fin for v in get(model).further_inputs)


def test_connectors_of_the_system_start_where_the_fins_inputs_do(model: str, written: tuple[Path, str]) -> None:
    """Each fin's own input has a connector of its own."""
    target = written[0].with_name("wired.ssp")
    write_ssp(target, written[0].with_name("unit.fmu"), fin_files={2: written[0].with_name("second.toml")}, border=True,
              model=model)
    starts = read_variant(target, "nominal").values
    preload = {i: starts.get(("", f"fin{i}_preload")) for i in (1, 2)}
    assert preload == ({1: 30.0, 2: 10.0} if get(model).further_inputs else {1: None, 2: None})
    assert (("", "supply_voltage") in starts) is (get(model).supply is not None)


def test_a_unit_of_several_starts_each_fins_own_input_at_its_value(model: str) -> None:
    base = load_parameters(model=model)
    both = (base, base.with_values(base.having({"spring.preload": 10.0})))
    require_shared(both, "here")  # which they do not share
    found = simulate_fins([each.values for each in both], 0.03, model=model)
    for i, each in enumerate(both, 1):
        alone = simulate(each.values, 0.03, kernel="python", model=model)
        assert np.array_equal(found[f"fin[{i}].fin_angle"], alone["fin_angle"])


def test_fmpy_computes_what_the_kernel_does(model: str, written: tuple[Path, str]) -> None:
    excitation = step_to(0.1, 0.2, -5.0)
    found: Mapping[int, list[float]] = {1: [], 2: []}
    with hosts.open(written[0], "fmpy") as system:
        for k in range(len(excitation.time) - 1):
            for i in found:
                for name, column in excitation.columns.items():
                    system.set(f"fin{i}.{name}", float(column[k]))
            system.step()
            for i, angles in found.items():
                angles.append(float(system.get(f"fin{i}.fin_angle")))
    base, columns = load_parameters(model=model), dict[str, Any](excitation.columns)
    for i, start in ((1, 0.0), (2, np.radians(3.0))):
        preload = base.having({"spring.preload": 10.0}) if i == 2 else {}
        values = base.with_values({"fin.start_angle": start, **preload}).values
        alone = simulate(values, excitation.stop, excitation.step, model=model, **columns)
        assert np.max(np.abs(alone["fin_angle"][1:] - found[i])) < SAME


@pytest.mark.parametrize(("of", "kept"), [("electrohydrostatic", False), ("electrohydrostatic+heat", True),
                                          ("electrohydraulic", False), ("linear", True)])
def test_a_variant_that_would_change_nothing_is_left_out(of: str, kept: bool) -> None:
    variants, left_out = derived(variant_files(()), Variant(NOMINAL, (load_parameters(model=of),)))
    assert ("cold" in [variant.name for variant in variants]) is kept
    assert ("variant cold: this actuator has no friction.temperature" in left_out) is not kept
