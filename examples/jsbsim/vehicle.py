"""The rocket in JSBSim: its inputs are fin angles, its outputs motion and hinge moments, in SI units.

JSBSim calculates in feet, pounds and slugs; only this module converts them.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from math import degrees
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from emcas_fmu.errors import EmcasError
from emcas_fmu.support.extras import require

Array = NDArray[Any]
FINS = (1, 2, 3, 4)
AZIMUTHS = np.radians([45.0, 135.0, 225.0, 315.0])
"""Azimuths of the fins about body x [rad], from y (right) towards z (down), as in the aircraft file and the FMU's
`mounting.azimuth`; fin 1 is right and below."""

STATION = -1.72
"""Position of the fins' hinges along body x, from the centre of gravity [m]."""

FOOT = 0.3048  # m, exact
POUND_FORCE = 4.4482216152605  # N, exact
_AIRCRAFT = "finned_rocket"
_ADAMS_BASHFORTH_2 = 3.0  # JSBSim's number for it
_INTEGRATORS = ("rate/rotational", "rate/translational", "position/rotational")


@dataclass(frozen=True)
class Launch:
    """The beginning of a flight, at burnout, in still air and without incidence.

    `altitude` [m] is above sea level; `speed` is in m/s, `attitude` (roll, pitch, true heading) in rad, `body_rates` in
    rad/s. `hinge` is the distance of the fins' hinges from their leading edges as a share of the mean chord; the centre
    of pressure is at 0.477 at Mach 2.
    """

    altitude: float = 3000.0
    speed: float = 650.0
    attitude: tuple[float, float, float] = (0.0, 0.5, 1.5)
    body_rates: tuple[float, float, float] = (0.0, 0.0, 0.0)
    hinge: float = 0.41


@dataclass(frozen=True)
class State:
    """The vehicle at one time; vectors of shape (3,) are in body axes: x forward, y right, z down.

    `attitude` (roll, pitch, yaw) is in rad, `body_rates` in rad/s, `angular_acceleration` in rad/s2. `acceleration`
    [m/s2] is that of the centre of gravity, including gravity. `hinge_moments` [N.m], shape (4,), are positive along a
    positive fin angle. `dynamic_pressure` is in Pa, `altitude` in m, `speed` through the air in m/s; `incidence` [rad]
    is the angle between axis and flow.
    """

    attitude: Array
    body_rates: Array
    angular_acceleration: Array
    acceleration: Array
    hinge_moments: Array
    dynamic_pressure: float
    mach: float
    altitude: float
    speed: float
    incidence: float


class Rocket:
    """The aircraft file in JSBSim, with fixed steps of `step` [s], at first in the `launch` condition.

    Raises EmcasError if JSBSim is not installed or refuses.
    """

    def __init__(self, step: float, launch: Launch | None = None) -> None:
        self._fdm = fdm = _executive()
        if not fdm.load_model(_AIRCRAFT):
            raise EmcasError(f"JSBSim does not load aircraft/{_AIRCRAFT}/{_AIRCRAFT}.xml; its messages say why")
        fdm.set_dt(step)
        # By default JSBSim integrates rotation by Euler's rule, whose error would hide that of the coupling.
        for name in _INTEGRATORS:
            fdm[f"simulation/integrator/{name}"] = _ADAMS_BASHFORTH_2
        chosen = launch or Launch()
        roll, pitch, yaw = map(degrees, chosen.attitude)
        for name, value in {"ic/lat-geod-deg": 40.0, "ic/h-sl-ft": chosen.altitude / FOOT,
                            "ic/u-fps": chosen.speed / FOOT, "ic/phi-deg": roll, "ic/theta-deg": pitch,
                            "ic/psi-true-deg": yaw, "fins/hinge-chord": chosen.hinge}.items():
            fdm[name] = value
        for name, rate in zip("pqr", chosen.body_rates, strict=True):
            fdm[f"ic/{name}-rad_sec"] = rate
        if not fdm.run_ic():
            raise EmcasError("JSBSim does not accept the launch condition")

    def __getitem__(self, name: str) -> float:
        """Return a property of JSBSim, in JSBSim's unit."""
        return float(self._fdm[name])

    def advance(self, fins: Array, wind: Array) -> State:
        """Step with fin angles [rad], shape (4,), and wind north, east, down [m/s], shape (3,); return the new state.

        JSBSim first moves the vehicle by the forces at the last step's end, then evaluates the forces of these inputs.
        """
        fdm = self._fdm
        for k, angle in zip(FINS, fins.tolist(), strict=True):
            fdm[f"actuators/fin{k}-rad"] = angle
        for axis, component in zip(("north", "east", "down"), wind.tolist(), strict=True):
            fdm[f"atmosphere/wind-{axis}-fps"] = component / FOOT
        fdm.run()
        return self.state()

    def state(self) -> State:
        """Return the present state of the vehicle."""
        fdm = self._fdm
        roll, pitch, yaw = (fdm[f"attitude/{n}-rad"] for n in ("phi", "theta", "psi"))
        gravity = fdm["accelerations/gravity-ft_sec2"] * FOOT
        specific_force = np.array([fdm[f"accelerations/a-pilot-{n}-ft_sec2"] for n in "xyz"]) * FOOT
        down = np.array([-np.sin(pitch), np.sin(roll) * np.cos(pitch), np.cos(roll) * np.cos(pitch)])
        u, v, w = (fdm[f"velocities/{n}-aero-fps"] for n in "uvw")
        return State(
            attitude=np.array([roll, pitch, yaw]),
            body_rates=np.array([fdm[f"velocities/{n}-rad_sec"] for n in "pqr"]),
            angular_acceleration=np.array([fdm[f"accelerations/{n}dot-rad_sec2"] for n in "pqr"]),
            acceleration=specific_force + gravity * down,
            hinge_moments=np.array([fdm[f"aero/hinge{k}-lbsft"] for k in FINS]) * (POUND_FORCE * FOOT),
            dynamic_pressure=fdm["aero/qbar-psf"] * POUND_FORCE / FOOT**2, mach=fdm["velocities/mach"],
            altitude=fdm["position/h-sl-ft"] * FOOT, speed=fdm["velocities/vt-fps"] * FOOT,
            incidence=float(np.arctan2(np.hypot(v, w), u)))


def check_installed() -> None:
    """Raise EmcasError if JSBSim is not installed."""
    require("jsbsim", "the flight needs", "jsbsim")


def _executive() -> Any:
    check_installed()
    jsbsim: Any = import_module("jsbsim")
    jsbsim.FGJSBBase().debug_lvl = 0  # no banner
    executive = jsbsim.FGFDMExec(str(Path(__file__).resolve().parent))
    executive.set_debug_level(0)
    executive.set_aircraft_path("aircraft")
    return executive
