"""Each extension with an actuator that provides only the capabilities that the extension needs."""

from __future__ import annotations

from math import radians
from pathlib import Path

import numpy as np
import pytest

from emcas_fmu.actuators import EXTENSIONS, capabilities, get, get_extension
from emcas_fmu.parameters import load_parameters
from emcas_fmu.simulation import simulate
from tests.marks import others_slow

STRAIN_WAVE = str(Path(__file__).parents[1] / "actuators" / "strain_wave.py")
LEAST = """
from dataclasses import replace

from emcas_fmu.actuators import get

ACTUATOR = replace(get({base!r}), name="least", provides=frozenset({needs}))
"""


# test_capabilities.py runs the extensions, too; heat and supply have further needs, which are only here.
@pytest.mark.parametrize("extension", others_slow(EXTENSIONS, lambda name: name in ("heat", "supply")))
def test_an_extension_computes_the_same_with_only_the_capabilities_it_needs(extension: str, tmp_path: Path) -> None:
    # Heat adds an ambient temperature if the actuator has none. Without the drive's equations supply and saturation
    # approximate voltage and current over a step by straight lines (tests/own_actuator/test_supply.py).
    further = {"heat": (capabilities.AMBIENT_TEMPERATURE,), "supply": (capabilities.DRIVE_STEP,),
               "saturation": (capabilities.DRIVE_STEP,)}
    needs = (*get_extension(extension).needs, *further.get(extension, ()))
    base = STRAIN_WAVE if get(STRAIN_WAVE).provides.issuperset(needs) else "nonlinear"
    path = tmp_path / "least.py"
    path.write_text(LEAST.format(base=base, needs=needs))
    path.with_suffix(".toml").touch()

    values = load_parameters(model=f"{base}+{extension}").values
    # Without a cascade's capability the monitors' response is a parameter; here it is that of the cascade.
    values = {"monitor.response": values["controller.position.kp"], **values}
    whole, least = (simulate({v.name: values[v.name] for v in get(f"{name}+{extension}").file_entries}, 0.1,
                     model=f"{name}+{extension}", kernel="python", fin_command=radians(5.0), aero_torque=-20.0)
            for name in (base, path))
    assert np.max(np.abs(least["fin_angle"])) > radians(1.0) or extension == "homing"
    # Without DRIVE_STEP heat approximates the current over a step by a straight line: 3e-8 of the angle (measured).
    for name, column in least.items():
        tolerance = 1e-4 * np.max(np.abs(whole[name])) if extension == "heat" else 0.0
        assert column == pytest.approx(whole[name], rel=0.0, abs=tolerance), name
