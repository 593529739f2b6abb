"""Archives of actuators without supply or screw, and of users' actuators: write, check, and run in fmpy."""

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
# A user's actuator with a further input, a hinge torque for each fin; the parameter file has its start value.
PRELOADED = (
    ("MOTOR_CURRENT = ", 'PRELOAD = em.real_input("preload", "N.m", "moment of the spring at 0", start=None, '
                         'key="spring.preload")\nMOTOR_CURRENT = '),
    ("    supply=em.", "    further_inputs=(PRELOAD,),\n    supply=em."),
    ("- p.spring.stiffness * x.fin_angle", "+ u.preload - p.spring.stiffness * x.fin_angle"),
)
# rad; FMU and kernel compute the same bits, and a host's clock differs by at most 1e-15 s (test_hosts.py).
SAME = 1e-9


@pytest.fixture(scope="module", params=["second-order", DIRECT_DRIVE, "preloaded"])
def model(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> str:
    """An actuator; the last one has a further input."""
    if request.param != "preloaded":
        return str(request.param)
    path = changed(tmp_path_factory.mktemp("preloaded"), *PRELOADED)
    path.with_suffix(".toml").write_text('spring.preload = "30 N*m"\n', encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def model_option(model: str) -> tuple[str, ...]:
    return ("--model", model) if model.endswith(".py") else ()


@pytest.fixture(scope="module")
def archive_and_output(model: str, model_option: tuple[str, ...], tmp_path_factory: pytest.TempPathFactory
                       ) -> tuple[Path, str]:
    """The archive of an actuator whose second fin has other parameters, and the command's output."""
    folder = tmp_path_factory.mktemp("actuator")
    unit = lean(load_parameters(model=model), folder / "unit.fmu")
    preload = 'spring.preload = "10 N*m"\n' if get(model).further_inputs else ""
    (folder / "second.toml").write_text(f'{preload}[fin]\nstart_angle = "3 deg"\n', encoding="utf-8")
    return folder / "a.ssp", emcas("--fmu", unit, "-o", folder / "a.ssp", "--fin", f"2={folder / 'second.toml'}",
                                   *model_option)


@pytest.fixture(scope="module")
def archive(archive_and_output: tuple[Path, str]) -> Path:
    return archive_and_output[0]


def test_variants_without_their_parameters_are_left_out(archive_and_output: tuple[Path, str],
                                                        model_option: tuple[str, ...]) -> None:
    path, output = archive_and_output
    assert "left out: variant cold: this actuator has no friction.temperature" in output
    assert "left out: variant degraded: this actuator has no" in output
    assert "variants nominal (SystemStructure.ssd); schema and wiring checked" in output
    assert emcas("check", path, *model_option).startswith("passed, 0 warnings")


def test_files_are_valid_and_have_the_actuators_inputs(model: str, archive: Path) -> None:
    assert valid_documents(archive)
    contents = read_archive(archive)
    assert (b"supply_voltage" in contents["SystemStructure.ssd"]) is (get(model).supply is not None)
    fin = contents["resources/nominal_fin2.ssv"]
    assert (b"supply_voltage" in fin) is (get(model).supply is not None)
    assert all(f'"{v.name}"'.encode() in fin for v in get(model).further_inputs)


def test_system_connectors_have_the_start_values_of_each_fins_inputs(model: str, archive: Path) -> None:
    target = archive.with_name("wired.ssp")
    write_ssp(target, archive.with_name("unit.fmu"), fin_files={2: archive.with_name("second.toml")}, border=True,
              model=model)
    starts = read_variant(target, "nominal").values
    preload = {i: starts.get(("", f"fin{i}_preload")) for i in (1, 2)}
    assert preload == ({1: 30.0, 2: 10.0} if get(model).further_inputs else {1: None, 2: None})
    assert (("", "supply_voltage") in starts) is (get(model).supply is not None)


def test_each_fin_of_several_has_its_own_start_value_of_a_further_input(model: str) -> None:
    base = load_parameters(model=model)
    sets = (base, base.with_values(base.having({"spring.preload": 10.0})))
    require_shared(sets, "here")  # the start value of a further input may differ between fins
    together = simulate_fins([each.values for each in sets], 0.03, model=model)
    for i, each in enumerate(sets, 1):
        alone = simulate(each.values, 0.03, kernel="python", model=model)
        assert np.array_equal(together[f"fin[{i}].fin_angle"], alone["fin_angle"])


def test_angles_in_fmpy_equal_the_kernels(model: str, archive: Path) -> None:
    excitation = step_to(0.1, 0.2, -5.0)
    angles: Mapping[int, list[float]] = {1: [], 2: []}
    with hosts.open(archive, "fmpy") as system:
        for k in range(len(excitation.time) - 1):
            for i in angles:
                for name, column in excitation.columns.items():
                    system.set(f"fin{i}.{name}", float(column[k]))
            system.step()
            for i in angles:
                angles[i].append(float(system.get(f"fin{i}.fin_angle")))
    base, columns = load_parameters(model=model), dict[str, Any](excitation.columns)
    for i, start in ((1, 0.0), (2, np.radians(3.0))):
        preload = base.having({"spring.preload": 10.0}) if i == 2 else {}
        values = base.with_values({"fin.start_angle": start, **preload}).values
        alone = simulate(values, excitation.stop, excitation.step, model=model, **columns)
        assert np.max(np.abs(alone["fin_angle"][1:] - angles[i])) < SAME


@pytest.mark.parametrize(("actuator", "has_cold"), [("electrohydrostatic", False), ("electrohydrostatic+heat", True),
                                                    ("electrohydraulic", False), ("linear", True)])
def test_variant_cold_exists_only_with_a_friction_temperature(actuator: str, has_cold: bool) -> None:
    variants, left_out = derived(variant_files(()), Variant(NOMINAL, (load_parameters(model=actuator),)))
    assert ("cold" in [variant.name for variant in variants]) is has_cold
    assert ("variant cold: this actuator has no friction.temperature" in left_out) is not has_cold
