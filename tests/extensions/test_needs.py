"""Each extension over an actuator that provides nothing but what the extension asks for."""

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


# Each runs over no more than it asks for in test_capabilities.py, too; heat and supply have needs of their own.
@pytest.mark.parametrize("extension", others_slow(EXTENSIONS, lambda name: name in ("heat", "supply")))
def test_an_extension_asks_for_all_it_uses(extension: str, tmp_path: Path) -> None:
    # Heat adds an ambient temperature where the actuator has none; this one has, and says so. Without the drive's
    # equations supply and saturation take voltage and current as lines (tests/own_actuator/test_supply.py).
    further = {"heat": (capabilities.AMBIENT_TEMPERATURE,), "supply": (capabilities.DRIVE_STEP,),
               "saturation": (capabilities.DRIVE_STEP,)}
    needs = (*get_extension(extension).needs, *further.get(extension, ()))
    base = STRAIN_WAVE if get(STRAIN_WAVE).provides.issuperset(needs) else "nonlinear"
    path = tmp_path / "least.py"
    path.write_text(LEAST.format(base=base, needs=needs))
    path.with_suffix(".toml").touch()

    values = load_parameters(model=f"{base}+{extension}").values
    values = {"monitor.response": values["controller.position.kp"], **values}  # the same, where no capability says so
    runs = (simulate({v.name: values[v.name] for v in get(f"{name}+{extension}").file_entries}, 0.1,
                     model=f"{name}+{extension}", kernel="python", fin_command=radians(5.0), aero_torque=-20.0)
            for name in (base, path))
    whole, least = runs
    assert np.max(np.abs(least["fin_angle"])) > radians(1.0) or extension == "homing"
    # Without DRIVE_STEP heat takes the current's course as a line; otherwise nothing depends on further capabilities.
    for name, values_of_least in least.items():
        room = 1e-4 * np.max(np.abs(whole[name])) if extension == "heat" else 0.0  # 3e-8 of the angle was seen
        assert values_of_least == pytest.approx(whole[name], rel=0.0, abs=room), name
