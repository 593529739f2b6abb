"""A missile's tail on a roll bearing in a wind tunnel, in MuJoCo: four fins, each turned by an FMU with torque out.

MuJoCo simulates the bodies, this module the air, the FMUs the actuators. In each step MuJoCo computes positions and
rates, the FMUs step with the angles and rates of their hinges, and MuJoCo steps with their torques.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emcas_fmu.support.extras import require
from examples.hardware_in_the_loop.coupling import Stepped

Array = NDArray[np.float64]
FINS = ("fin1", "fin2", "fin3", "fin4")
COLUMNS = ("time", "roll", "roll_rate", *(f"{fin}_{what}" for what in ("command", "angle", "torque") for fin in FINS))
SPEED, PRESSURE = 300.0, 54e3  # speed [m/s] and dynamic pressure [Pa] of air of 1.2 kg/m3
AREA, SLOPE = 0.02, 3.0  # area of a fin [m2], and slope of its normal force coefficient [1/rad]
STIFFNESS, DAMPING = 0.11, 0.013  # autopilot: fin command per roll angle [rad/rad] and per roll rate [s]


class Rig:
    """The rig with an actuator for each fin: FMUs, or objects with the same methods.

    `step` is MuJoCo's time step [s], `inertia` the ratio of each fin's inertia about its hinge to that in the file.
    Raises EmcasError without MuJoCo.
    """

    def __init__(self, actuators: Sequence[Stepped], step: float = 1e-3, inertia: float = 1.0) -> None:
        require("mujoco", "the rig needs", "mujoco")
        mujoco: Any = import_module("mujoco")
        self._mujoco = mujoco
        self.model = mujoco.MjModel.from_xml_path(str(Path(__file__).with_name("rig.xml")))
        self.model.opt.timestep, self.actuators = step, actuators
        self.hinges = [self.model.joint(fin).dofadr[0] for fin in FINS]
        for actuator, fin, hinge in zip(actuators, FINS, self.hinges, strict=True):
            self.model.dof_armature[hinge] = actuator.signals()["armature"]
            self.model.body(fin).inertia[1] *= inertia
        self.data = mujoco.MjData(self.model)

    def air(self, fin: str) -> Array:
        """Return the generalised forces [SI] of the air on a fin, from a normal force at its centre of pressure.

        The force is proportional to the sine of the angle between fin and flow there, including the fin's rate and the
        roll rate.
        """
        site, jacobian = self.data.site(fin), np.zeros((3, self.model.nv))
        self._mujoco.mj_jacSite(self.model, self.data, jacobian, None, site.id)
        normal = -site.xmat.reshape(3, 3)[:, 2]  # up, seen with the hinge pointing to the right
        flow = np.array([-SPEED, 0.0, 0.0]) - jacobian @ self.data.qvel
        force: Array = jacobian.T @ (PRESSURE * AREA * SLOPE * (flow @ normal) / SPEED * normal)
        return force

    def run(self, stop: float, roll_command: Callable[[float], float]) -> Array:
        """Return COLUMNS [SI] for each step up to `stop` [s]: an array [steps, columns].

        The roll command [rad] is a function of time [s].
        """
        model, data, step = self.model, self.data, self.model.opt.timestep
        rows = []
        for k in range(round(stop / step)):
            self._mujoco.mj_step1(model, data)
            roll, rate = data.joint("roll").qpos[0], data.joint("roll").qvel[0]
            # Fins with their leading edges up, seen with the hinge pointing to the right, roll the tail to the left.
            command = -STIFFNESS * (roll_command(k * step) - roll) + DAMPING * rate
            torques = [self._torque(i, k * step, step, command) for i in range(len(FINS))]
            angles = data.qpos[self.hinges]
            rows.append((k * step, roll, rate, *(command,) * len(FINS), *angles, *torques))
            data.qfrc_applied = sum(self.air(fin) for fin in FINS)
            data.qfrc_applied[self.hinges] += torques
            self._mujoco.mj_step2(model, data)
        return np.array(rows)

    def _torque(self, i: int, time: float, step: float, command: float) -> float:
        """Step an actuator; return its torque [N.m] during the step."""
        hinge = self.hinges[i]
        self.actuators[i].step(time, step, {"fin_command": command, "hinge_angle": self.data.qpos[hinge],
                                            "hinge_rate": self.data.qvel[hinge]})
        return self.actuators[i].signals()["actuator_torque"]
