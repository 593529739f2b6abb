"""Currents, power and energy over a mission profile: the user's, or a synthetic one."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..excitation import Excitation, from_file
from .bench import STEP, Bench
from .outcome import Array, Outcome, Quantity, mean

NAME = "mission"
LAG = 0.02  # s, of the hinge moment behind the command in the synthetic profile
RATE = 150.0  # deg/s, of the commands of the synthetic profile
# Phase, its end [s], hinge moment at the end of the range as a share of the rated load there.
PHASES = (("launch", 2.0, 0.1), ("pitch-over", 5.0, 0.5), ("midcourse", 10.0, 0.6), ("terminal", 15.0, 1.0))

QUANTITIES = (
    Quantity("motor_current_rms_a", "RMS current", "root mean square of the motor current over the profile"),
    Quantity("motor_current_peak_a", "peak current", "largest magnitude of the motor current"),
    Quantity("supply_power_peak_w", "peak power", "largest power drawn from the bus as read every 1 ms; transients of "
             "the current loop, which are shorter, can be higher"),
    Quantity("regenerated_power_peak_w", "peak power fed back", "largest power fed back, as read every 1 ms"),
    Quantity("energy_drawn_j", "energy drawn", "integral of the power where it is positive (trapezoid, 1 ms)"),
    Quantity("energy_regenerated_j", "energy regenerated", "integral of the power fed back, as a magnitude; whether "
             "the bus can take it is not modelled"),
    Quantity("net_energy_j", "net energy", "drawn less regenerated"),
    Quantity("supply_power_mean_w", "mean power", "net energy over the profile's duration"),
    Quantity("tracking_error_rms_deg", "RMS tracking error", "root mean square of command - angle"),
    Quantity("limited_percent", "limited", "share of the outputs at which a limit is active"),
    Quantity("duration_s", "duration", "of the profile"),
)


def synthetic(limit: float, load: float, step: float = STEP) -> tuple[Array, Array]:
    """Command [deg] and hinge moment [N.m] of a made-up mission of 15 s, an assumption and no flight record.

    With c the limit of the command: launch, 2 s, trim at 0.05 c with a roll correction of 0.1 c at 1 Hz;
    pitch-over, 3 s, doublets to ±0.5 c held 0.5 s each; midcourse, 5 s, trim at 0.1 c under sines of 0.04 c at
    0.7, 1.9 and 4.3 Hz; terminal, 5 s, steps to 0.75, -0.6, 0.9, -0.75 c and 0 of 1 s each under a weave of 0.05 c
    at 3 Hz. Commands change by at most 150 deg/s. The hinge moment restores: it is proportional to
    the command 20 ms before, and at c would be 0.1, 0.5, 0.6 and 1 times the rated load.
    """
    time = np.arange(round(PHASES[-1][1] / step) + 1) * step
    wave = 2.0 * np.pi * time
    doublet = np.where(np.floor((time - 2.0) / 0.5) % 2 < 0.5, 0.5, -0.5)
    busy = 0.1 + 0.04 * (np.sin(0.7 * wave) + np.sin(1.9 * wave) + np.sin(4.3 * wave))
    levels = np.array([0.75, -0.6, 0.9, -0.75, 0.0, 0.0])
    terminal = levels[np.clip((time - 10.0).astype(int), 0, 5)] + 0.05 * np.sin(3.0 * wave)
    starts = np.searchsorted([end for _, end, _ in PHASES], time, side="right").clip(max=3)
    wanted = limit * np.choose(starts, [0.05 + 0.1 * np.sin(wave), doublet, busy, terminal])
    command = np.zeros_like(time)
    for k in range(1, len(time)):
        command[k] = command[k - 1] + np.clip(wanted[k] - command[k - 1], -RATE * step, RATE * step)
    late = round(LAG / step)
    before = np.concatenate([np.zeros(late), command[:-late]])
    share = np.array([share for _, _, share in PHASES])[starts]
    return command, -load * share * before / limit


def energies(time: Array, power: Array) -> tuple[float, float]:
    """Energy [J] drawn and, as a magnitude, regenerated."""
    return (float(np.trapezoid(np.maximum(power, 0.0), time)), float(np.trapezoid(np.maximum(-power, 0.0), time)))


def from_csv(path: Path) -> Excitation:
    """A mission of the user's: CSV with a column time [s] and columns of inputs in SI. Raises EmcasError."""
    return from_file(path, STEP, None)


def measure(bench: Bench) -> Outcome:
    """Run the profile and add up."""
    if bench.mission is None:
        command, moment = synthetic(bench.limit, bench.load)
        inputs = {"fin_command": np.radians(command), "aero_torque": moment}
        group, label = "synthetic", "synthetic profile"
        method = "Synthetic mission profile: " + _TOLD
        estimate = ("The mission profile is made up, as a plausible sequence of phases; currents, power and energy are "
                    "estimates of the order of magnitude. Give the real one with --mission.")
    else:
        inputs = dict(bench.mission.columns)
        group, label = "file", bench.mission.title
        method, estimate = f"Profile of {bench.mission.title}, {bench.mission.stop:g} s, inputs held over 1 ms.", ""
    run = bench.run(inputs)
    zero = np.zeros(len(run["time"]))
    limit = np.radians(bench.limit)
    wanted = np.degrees(np.clip(inputs.get("fin_command", zero), -limit, limit))
    time, power, current = run["time"], run["supply_power"], run["motor_current"]
    angle = np.degrees(run["fin_angle"])
    drawn, regenerated = energies(time, power)
    duration = float(time[-1])
    figures = {
        "motor_current_rms_a": float(np.sqrt(mean(current**2))),
        "motor_current_peak_a": float(np.max(np.abs(current))),
        "supply_power_peak_w": float(np.max(power, initial=0.0)),
        "regenerated_power_peak_w": float(np.max(-power, initial=0.0)),
        "energy_drawn_j": drawn, "energy_regenerated_j": regenerated, "net_energy_j": drawn - regenerated,
        "supply_power_mean_w": (drawn - regenerated) / duration if duration else 0.0,
        "tracking_error_rms_deg": float(np.sqrt(mean((wanted - angle) ** 2))),
        "limited_percent": 100.0 * mean(run["saturated"] > 0.5), "duration_s": duration}
    return Outcome(
        NAME, "Mission profile", method, QUANTITIES, {group: figures},
        tuple(f"{group}.{key}" for key in ("motor_current_rms_a", "supply_power_peak_w", "energy_drawn_j",
                                           "energy_regenerated_j")),
        {group: label},
        series={group: {"time_s": time, "command_deg": wanted, "angle_deg": angle, "current_a": current,
                        "power_w": power, "moment_n_m": np.asarray(inputs.get("aero_torque", zero))}},
        estimate=estimate)


_TOLD = (
    "launch (2 s, trim and roll correction), pitch-over (3 s of doublets to half the range), midcourse (5 s, three "
    "sines about a trim), terminal (5 s, steps to 90 % of the range under a weave at 3 Hz). Commands change by at most "
    "150 deg/s; the hinge moment restores, in proportion to the command 20 ms before, and at the end of the range is "
    "10, 50, 60 and 100 % of the rated load.")
