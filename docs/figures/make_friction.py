"""Table and pictures of docs/model/friction.md.

    python docs/figures/make_friction.py           # writes the table between its markers, and the pictures
    python docs/figures/make_friction.py --check   # exit code 1 if the table is stale
    python docs/figures/make_friction.py --cost    # prints the CPU time of a simulated second
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping
from math import pi, radians, sin
from typing import Any

import numpy as np
from make_tables import main, markdown, save

from emcas_fmu.bench.metrics import settling
from emcas_fmu.parameters import load_parameters
from emcas_fmu.plotting import plots
from emcas_fmu.simulation import simulate

NONE = {f"friction.coulomb.{way}[{n}]": 0.0 for way in ("positive", "negative") for n in range(7)}
# Title, model, overrides, colour.
CHOICES: tuple[tuple[str, str, Mapping[str, float], str], ...] = (
    ("none", "nonlinear", NONE, plots.GRAY),
    ("Coulomb", "nonlinear", {}, plots.BLUE),
    ("Stribeck", "nonlinear+stribeck", {}, plots.VERMILLION),
    ("LuGre", "nonlinear+lugre", {}, plots.GREEN),
)
ROUGH: tuple[tuple[str, str, Mapping[str, float], str], ...] = (
    ("Stribeck, s = 2", "nonlinear+stribeck", {"stribeck.static_ratio": 2.0}, ""),
    ("LuGre, s = 2", "nonlinear+lugre", {"lugre.static_ratio": 2.0}, ""),
)
AMPLITUDE, FREQUENCY = 0.5, 0.2  # deg, Hz
STEP, BAND = 0.1, 0.01  # deg
FASTEST = 0.25  # s, duration of the part of the sine in which it is fastest, up to its zero
SETTLED, LONG = 20.0, 300.0  # s after the step: begin and end of the mean error and of hunting
STUCK = 0.02  # rad/s at the motor, 3 % of the sine's largest speed


def _sine(t: float) -> float:
    return radians(AMPLITUDE) * sin(2.0 * pi * FREQUENCY * t)


def _run(model: str, overrides: Mapping[str, Any], stop: float, step: float = 1e-3, **inputs: Any) -> dict[str, Any]:
    return simulate(load_parameters(model=model).with_values(overrides).values, stop, step, model=model, **inputs)


def _row(title: str, model: str, overrides: Mapping[str, float], gain: float) -> list[str]:
    values = {**overrides, "compensation.gain": gain}
    slow = _run(model, values, 3.0 / FREQUENCY, fin_command=_sine)
    last = slice(round(2e3 / FREQUENCY), None)
    error = np.degrees(slow["tracking_error"][last])
    fast = slow["time"] >= 3.0 / FREQUENCY - FASTEST
    times, errors = slow["time"][fast], np.degrees(slow["tracking_error"][fast])
    ripple = np.ptp(errors - np.polyval(np.polyfit(times, errors, 1), times))
    stuck = np.mean(np.abs(slow["motor_speed"][last]) < STUCK)
    step = _run(model, values, LONG, fin_command=radians(STEP))
    angle = np.degrees(step["fin_angle"])
    settled = settling(step["time"], np.abs(angle - STEP), BAND)
    late = angle[round(SETTLED * 1e3):]
    return [title, f"{np.sqrt(np.mean(error**2)):.4f}°", f"{np.abs(error).max():.3f}°", f"{100.0 * stuck:.0f} %",
            f"{ripple:.3f}°", f"{max(angle.max() - STEP, 0.0):.3f}°", f"{settled:.2f} s",
            f"{np.mean(late) - STEP:+.4f}°", f"{np.ptp(late):.4f}°"]


def table() -> str:
    """Return the table of a slow sine and a small step with each friction model, without and with compensation."""
    rows = [_row(title + words, model, overrides, gain) for gain, words in ((0.0, ""), (1.0, ", fed forward"))
            for title, model, overrides, _ in CHOICES + ROUGH if title != "none" or not gain]
    return markdown(("", "sine: rms error", "peak", "stuck", "ripple", "step: overshoot", "settling", "mean error",
                     "hunting"), rows)


TABLES: Mapping[str, Mapping[str, Callable[[], str]]] = {"model/friction.md": {"friction": table}}


def _tracking() -> None:
    with plots.style():
        figure, axes = plots.figure(1, 2, height=3.2, sharey=True)
        for (axis,), gain, words in ((axes[:, 0], 0.0, "no compensation"), (axes[:, 1], 1.0, "Coulomb fed forward")):
            for title, model, overrides, color in CHOICES:
                run = _run(model, {**overrides, "compensation.gain": gain}, 3.0 / FREQUENCY, fin_command=_sine)
                last = slice(round(2e3 / FREQUENCY), None)
                axis.plot(run["time"][last] - 2.0 / FREQUENCY, np.degrees(run["tracking_error"][last]), color=color,
                          label=title, linewidth=1.0)
            axis.set(xlabel="time in the cycle [s]", title=f"Slow sine, {words}")
        axes[0][0].set(ylabel="tracking error [deg]")
        axes[0][1].legend(loc="upper right")
        save(figure, "friction_tracking")


def _loops() -> None:
    """Plot presliding loops and friction against speed, with equal friction at all angles and in both directions."""
    level = 0.2
    even = {**NONE, "friction.coulomb.positive[0]": level, "friction.coulomb.negative[0]": level}
    smooth = {"encoder.enabled": False, "compensation.gain": 0.0}
    values = load_parameters(model="nonlinear+lugre").values
    ratio = values["kinematics.moment_arm"] / values["screw.lead"] / np.cos(values["kinematics.initial_angle"])**2
    with plots.style():
        figure, axes = plots.figure(1, 2, height=3.2)
        for share, color in ((0.4, plots.SKY), (0.8, plots.BLUE), (1.2, plots.VERMILLION)):
            run = _run("nonlinear+lugre", even, 20.0, enable=False,
                       aero_torque=lambda t, share=share: share * level * ratio * sin(0.2 * pi * t))
            axes[0][0].plot(1e3 * run["motor_angle"], run["friction_torque"], color=color,
                            label=f"load of {share:g} Coulomb")
        axes[0][0].set(xlabel="motor angle [mrad]", ylabel="friction torque [N·m]", title="LuGre: presliding")
        axes[0][0].legend(loc="lower right")
        speed = np.linspace(-8.0, 8.0, 801)
        excess = 1.0 + (values["lugre.static_ratio"] - 1.0) * np.exp(-(speed / values["lugre.stribeck_speed"])**2)
        axes[0][1].plot(speed, level * np.sign(speed), color=plots.GRAY, label="Coulomb")
        axes[0][1].plot(speed, level * excess * np.sign(speed), color=plots.VERMILLION, label="Stribeck")
        for frequency, color in ((0.5, plots.GREEN), (4.0, plots.SKY)):
            amplitude = 8.0 / (2.0 * pi * frequency) / ratio
            run = _run("nonlinear+lugre", {**even, **smooth}, 4.0 / frequency, 2e-4,
                       fin_command=lambda t, a=amplitude, f=frequency: a * sin(2.0 * pi * f * t))
            last = run["time"] >= 3.0 / frequency
            axes[0][1].plot(run["motor_speed"][last], run["friction_torque"][last], color=color,
                            label=f"LuGre at {frequency:g} Hz")
        axes[0][1].set(xlabel="motor speed [rad/s]", ylabel="friction torque [N·m]", title="Friction against speed",
                       xlim=(-5.0, 5.0))
        axes[0][1].legend(loc="lower right")
        save(figure, "friction_loops")


def _cost() -> None:
    for title, model, overrides, _ in CHOICES:
        times = []
        for kernel, stop in (("compiled", 10.0), ("python", 2.0)):
            values = load_parameters(model=model).with_values(overrides).values
            runs = []
            for _ in range(3):
                begun = time.process_time()
                simulate(values, stop, model=model, kernel=kernel, fin_command=_sine)
                runs.append((time.process_time() - begun) / stop * 1e3)
            times.append(min(runs))
        print(f"{title}: {times[0]:.2f} ms of CPU per simulated second compiled, {times[1]:.0f} ms in Python")


if __name__ == "__main__":
    if "--cost" in sys.argv[1:]:
        _cost()
        sys.exit()
    check = "--check" in sys.argv[1:]
    if not check:
        _tracking()
        _loops()
    sys.exit(main(check, TABLES, "make_friction.py"))
