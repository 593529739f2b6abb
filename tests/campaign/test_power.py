"""Power and energy of experiments, which jump at every sample of the controller, against finer rows and balances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.bench.excitation import Excitation
from emcas_fmu.bench.subject import ParameterSubject
from emcas_fmu.motions import LEAD_IN, STEP
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.campaign import experiments
from emcas_fmu.studies.campaign.experiments import Experiment, Profile, excitation

FINE = 50  # rows per STEP: 20 us
SUBJECT = ParameterSubject(load_parameters())
Values = Mapping[str, Any]


def figures(experiment: Experiment, numbers: Values, changes: Values, power: Any = None) -> dict[str, float]:
    """Return the figures of an experiment by name, from its supply power or from `power` [W]."""
    run = SUBJECT.run(excitation(experiment, SUBJECT.values, numbers, SUBJECT.model), changes,
                      substeps=experiments.POWER_ROWS, fine=[experiments.POWER])
    if power is not None:
        run = replace(run, columns={**run.columns, experiments.POWER: power})
    return experiments.measured(experiment, numbers, run, experiments.leaps(SUBJECT, changes, run))


def step(degrees: float, *profiles: Profile, **load: float) -> tuple[Excitation, dict[str, float]]:
    """Return the excitation of a step and its figures; `load` are the numbers of the profile."""
    experiment = Experiment("a", "step", 0.6, profiles)
    numbers = {"experiments.a.amplitude": radians(degrees), **{f"load.{k}": v for k, v in load.items()}}
    return excitation(experiment, SUBJECT.values, numbers, SUBJECT.model), figures(experiment, numbers, {})


def fine_response(applied: Excitation) -> dict[str, Any]:
    """Return all outputs from the command on, in rows of 20 us."""
    first = round(LEAD_IN / STEP) * FINE
    columns = SUBJECT.run(applied, substeps=FINE, fine=list(SUBJECT.outputs)).columns
    return {name: column[first:] for name, column in columns.items() if name != "time"}


@pytest.mark.parametrize(("degrees", "energy", "rms"), [
    (1.0, 0.008, 0.033),  # -0.6 and -2.8 %: much of the power is in spikes shorter than the rows of 0.2 ms
    (5.0, 0.002, 0.006),  # -0.1 and -0.4 %
    (20.0, 0.002, 0.004),  # -0.1 and -0.2 %
])
def test_energy_and_rms_power_agree_with_rows_of_20_us(degrees: float, energy: float, rms: float) -> None:
    """docs/tools/campaigns.md has the deviations; the tolerances are at least 1.19 times as large."""
    applied, found = step(degrees)
    power = fine_response(applied)["supply_power"]
    assert found["net_energy"] == pytest.approx(np.trapezoid(power, dx=STEP / FINE), rel=energy)
    assert found["rms_power"] == pytest.approx(np.sqrt(np.mean(power**2)), rel=rms)


def test_energy_balance_of_supply_winding_and_shaft() -> None:
    """The supply gives copper loss, work of the motor torque, and the change of the field energy.

    The two integrals differ by 0.8 % because of the rows of 0.2 ms. The motor also regenerates: the integral of the
    absolute power is 29 % larger.
    """
    applied, found = step(1.0)
    fine, values = fine_response(applied), SUBJECT.values
    current, speed = fine["motor_current"], fine["motor_speed"]
    copper = values["motor.resistance"] * current**2
    shaft = values["motor.back_emf_constant"] * speed * current
    field = values["motor.inductance"] / 2.0 * (current[-1]**2 - current[0]**2)
    assert found["net_energy"] == pytest.approx(np.trapezoid(copper + shaft, dx=STEP / FINE) + field, rel=0.015)
    assert found["net_energy"] < 0.85 * np.trapezoid(np.abs(fine["supply_power"]), dx=STEP / FINE)


def test_run_with_a_negligible_spring_has_the_same_power() -> None:
    _, plain = step(5.0)
    _, sprung = step(5.0, Profile("aero_torque", "spring", "load"), stiffness=1e-9, offset=0.0)
    for name in ("net_energy", "rms_power", "peak_power"):
        assert sprung[name] == pytest.approx(plain[name], rel=1e-6)


@pytest.mark.parametrize("delay", [3.0, 3.25, 3.7])
def test_energy_of_a_sawtooth_is_exact_wherever_it_jumps(delay: float) -> None:
    """The transport delay [ms] determines where the power jumps between rows."""
    experiment = Experiment("a", "hold", 0.1)
    rows = experiments.POWER_ROWS
    time = np.arange(round((LEAD_IN + 0.1) / STEP) * rows + 1) * STEP / rows - LEAD_IN
    phase = np.mod(time / STEP - delay % 1.0 - 1e-6, 1.0)  # a row at a jump has the value before it
    found = figures(experiment, {"experiments.a.amplitude": 0.0}, {"drive.transport_delay": delay * 1e-3},
                    7.0 - 4.0 * phase)
    assert found["net_energy"] == pytest.approx(0.1 * 5.0, rel=0.005)  # the first and last period are incomplete


def test_jumps_closer_than_the_rows_resolve_are_ignored() -> None:
    hold = excitation(Experiment("a", "hold", 0.1), SUBJECT.values, {"experiments.a.amplitude": 0.0}, SUBJECT.model)
    run = SUBJECT.run(hold)
    lengths = [[len(each) for each in experiments.leaps(SUBJECT, changes, run)] for changes in (
        {"controller.sample_time": 0.25e-3}, {}, {"controller.sample_time": np.array([0.25e-3, 1e-3])})]
    assert lengths == [[0], [100], [0, 100]]
