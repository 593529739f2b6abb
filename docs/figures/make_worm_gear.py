"""Plot the picture of docs/model/worm_gear.md: `python docs/figures/make_worm_gear.py`."""

from __future__ import annotations

from math import atan, cos, degrees, radians, tan
from typing import Any

import numpy as np
from make_tables import save

from emcas_fmu.actuators import get
from emcas_fmu.ops.floats import FLOATS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.physics import worm
from emcas_fmu.plotting import plots

MODEL = "worm-gear"
BASE = load_parameters(model=MODEL).values
LOAD = 100.0  # N.m
RATE = 100.0  # deg/s
FRICTION = (0.05, 0.10, 0.15)  # well oiled in motion, the default, dry at rest
RATIOS = (40.0, 60.0, 80.0)
LEADS = np.linspace(2.5, 25.0, 91)  # deg
DEFAULT = degrees(atan(BASE["worm.starts"] / BASE["worm.diameter_quotient"]))


def plant(lead: float, friction: float, ratio: float = 60.0) -> Any:
    """Return the plant's parameters for a lead angle [deg], with the number of starts of a worm of usual thickness."""
    starts = 1.0 if lead < 8.0 else 2.0 if lead < 14.0 else 4.0
    return get(MODEL).plant({**BASE, "worm.starts": starts, "worm.teeth": ratio * starts,
                             "worm.diameter_quotient": starts / tan(radians(lead)), "worm.friction": friction})


def motor_torque(p: Any, load: float) -> float:
    """Return the torque [N.m] of a slowly turning motor against a hinge moment `load` [N.m], along it if negative."""
    at_worm = (load + p.friction.fin_coulomb) / worm.ratio(p)
    share = 1.0 / worm.forward(FLOATS, p, 0.0) if at_worm > 0.0 else worm.backward(FLOATS, p, 0.0)
    return float(p.friction.coulomb.positive[0] + share * at_worm)


def steady_rate(p: Any, load: float) -> float:
    """Return the fin rate [deg/s] that the supply allows against a load [N.m]: V = R i + K_e w; 0 at stall."""
    motor, viscous = p.motor, p.friction.viscous.positive
    per_torque = motor.resistance / motor.torque_constant
    current = motor_torque(p, load) / motor.torque_constant
    speed = ((p.drive.supply_voltage - per_torque * motor_torque(p, load))
             / (motor.back_emf_constant + per_torque * viscous))
    return degrees(speed / worm.ratio(p)) if current < p.drive.current_limit else 0.0


def power(p: Any, load: float) -> float:
    """Return the supply power [W] at RATE against a hinge moment [N.m]."""
    speed = radians(RATE) * worm.ratio(p)
    current = (motor_torque(p, load) + p.friction.viscous.positive * speed) / p.motor.torque_constant
    return float(p.motor.resistance * current**2 + p.motor.back_emf_constant * speed * current)


def _over_leads(axis: Any, values: Any, **look: Any) -> None:
    axis.plot(LEADS, [values(lead) for lead in LEADS], **look)


def _efficiency(axis: Any) -> None:
    for mu, color in zip(FRICTION, (plots.GREEN, plots.BLUE, plots.VERMILLION), strict=True):
        _over_leads(axis, lambda lead, mu=mu: 100.0 * worm.forward(FLOATS, plant(lead, mu), 0.0), color=color,
                    label=f"friction {mu:.2f}")
        _over_leads(axis, lambda lead, mu=mu: 100.0 * worm.backward(FLOATS, plant(lead, mu), 0.0), color=color,
                    linestyle="--")
    axis.plot(DEFAULT, 100.0 * worm.forward(FLOATS, plant(DEFAULT, 0.10), 0.0), "o", color=plots.BLUE)
    axis.plot(DEFAULT, 100.0 * worm.backward(FLOATS, plant(DEFAULT, 0.10), 0.0), "o", color=plots.BLUE)
    axis.axhspan(-100.0, 0.0, color=plots.GRAY, alpha=0.18, linewidth=0.0)
    axis.text(24.6, -46.0, "below 0: no load moves the fin", ha="right", va="center")
    axis.set(title="Efficiency: — motor drives fin, - - load drives motor", ylabel="efficiency [%]",
             ylim=(-60.0, 100.0))
    axis.legend(loc="center right", bbox_to_anchor=(1.0, 0.47))


def _locking(axis: Any) -> None:
    needed = cos(BASE["worm.pressure_angle"]) * np.tan(np.radians(LEADS))  # where the backward efficiency is 0
    axis.plot(LEADS, needed, color=plots.BLUE)
    axis.fill_between(LEADS, needed, 0.45, color=plots.GREEN, alpha=0.18, linewidth=0.0)
    for mu, text in ((0.05, "in motion, well oiled: 0.05"), (0.10, "default: 0.10"), (0.15, "at rest, dry: 0.15")):
        axis.axhline(mu, **plots.LIMIT)
        axis.text(24.8, mu + 0.004, text, ha="right", va="bottom")
    axis.plot(DEFAULT, 0.10, "o", color=plots.BLUE)
    axis.text(4.5, 0.33, "enough friction: locks", ha="left", va="center")
    axis.text(6.0, 0.022, "too little: a load drives the motor", ha="left", va="center")
    axis.set(title="Friction that locking needs, and what there is", ylabel="friction coefficient", ylim=(0.0, 0.45))


def _rate(axis: Any) -> None:
    for ratio, color in zip(RATIOS, (plots.GREEN, plots.BLUE, plots.VERMILLION), strict=True):
        for load, line, text in ((0.0, "--", "no load"), (LOAD, "-", f"against {LOAD:.0f} N·m")):
            _over_leads(axis, lambda lead, ratio=ratio, load=load: steady_rate(plant(lead, 0.10, ratio), load),
                        color=color, linestyle=line, label=f"1 : {ratio:.0f}, {text}")
    axis.plot(DEFAULT, steady_rate(plant(DEFAULT, 0.10), LOAD), "o", color=plots.BLUE)
    axis.axhline(200.0, **plots.LIMIT)
    axis.text(24.8, 190.0, f"required against {LOAD:.0f} N·m", ha="right", va="top")
    axis.text(4.3, 60.0, "1 : 40 stalls where 60 A do not move the load", ha="left", va="center")
    axis.set(title="Steady rate that 39 V and 60 A allow, friction 0.10", ylabel="fin rate [deg/s]", ylim=(0.0, 650.0))
    axis.legend(loc="upper center", ncols=3, fontsize=6.8, columnspacing=1.0, handlelength=1.6)


def _power(axis: Any) -> None:
    for mu, color in zip(FRICTION, (plots.GREEN, plots.BLUE, plots.VERMILLION), strict=True):
        _over_leads(axis, lambda lead, mu=mu: power(plant(lead, mu), LOAD), color=color, label=f"friction {mu:.2f}")
        _over_leads(axis, lambda lead, mu=mu: power(plant(lead, mu), -LOAD), color=color, linestyle="--")
    for load in (LOAD, -LOAD):
        axis.plot(DEFAULT, power(plant(DEFAULT, 0.10), load), "o", color=plots.BLUE)
    axis.axhspan(-300.0, 0.0, color=plots.GRAY, alpha=0.18, linewidth=0.0)
    axis.text(3.0, -200.0, "below 0: goes back into the supply", ha="left", va="center")
    axis.set(title=f"Supply power at {RATE:.0f} deg/s: — against, - - with {LOAD:.0f} N·m", ylabel="power [W]",
             ylim=(-250.0, 1500.0))
    axis.legend(loc="upper right")


def main() -> None:
    """Plot efficiency, locking, rate and power against the lead angle."""
    with plots.style():
        figure, axes = plots.figure(2, 2, height=3.1, width=10.0)
        for draw, axis in zip((_efficiency, _locking, _rate, _power), axes.flat, strict=True):
            draw(axis)
            axis.set(xlim=(2.5, 25.0), xlabel="lead angle of the worm [deg]; dot: the default, 5.7 deg")
        save(figure, "worm_gear")


if __name__ == "__main__":
    main()
