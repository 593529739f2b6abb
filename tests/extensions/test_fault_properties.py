"""Random combinations of faults, equal kernels, and states restored during faults."""

from __future__ import annotations

from collections.abc import Mapping
from math import sin
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from emcas_fmu.actuators import get
from emcas_fmu.extensions.fault_list import FAULTS, possible
from emcas_fmu.parameters import load_parameters
from emcas_fmu.runtime import codegen
from emcas_fmu.simulation import simulate
from tests.marks import others_slow
from tests.simulation import CompiledCore

from .fault_runs import gust, wave

_windows = st.dictionaries(st.sampled_from([f.name for f in FAULTS]),
                           st.tuples(st.floats(0.0, 0.15), st.floats(0.0, 0.1)), min_size=1, max_size=5)
_sizes = st.fixed_dictionaries({
    "hard_over.share": st.floats(-1.0, 1.0), "current_derating.share": st.floats(0.0, 1.0),
    "brown_out.share": st.floats(0.0, 1.0), "encoder_bias.angle": st.floats(-0.5, 0.5),
    "encoder_dropped.share": st.floats(0.0, 1.0), "command_delay.time": st.floats(0.0, 0.05),
    "friction_rise.factor": st.floats(1.0, 1e4), "backlash_growth.gap": st.floats(0.0, 0.002)})
# Largest acceleration of the fin [rad/s2]. Rigid: 200 A of a shorted motor accelerate its 3e-4 kg.m2 by 22 N.m, and the
# fin by 1200; 150 N.m accelerate the broken fin by 2800. Elastic: a rotor of 3e-4 kg.m2 at 1300 rad/s has 250 J, which
# twist the line of 2e5 N.m/rad to a torque of 1e4 N.m: 1.7e5 for a fin of 0.06 kg.m2.
RIGID, ELASTIC = 4e3, 2e5


@pytest.mark.parametrize("model", others_slow(
    ["nonlinear", "elastic", "second-order", "ristanovic", "ozkan"], lambda model: model not in ("elastic", "ozkan")))
@settings(derandomize=True, max_examples=20, suppress_health_check=[HealthCheck.too_slow])
@given(windows=_windows, sizes=_sizes, command=st.floats(-0.4, 0.4), load=st.floats(-150.0, 150.0),
       enabled=st.sampled_from([True, True, True, False]))
def test_no_combination_of_faults_makes_the_fin_jump(model: str, windows: Mapping[str, tuple[float, float]],
                                                     sizes: Mapping[str, float], command: float, load: float,
                                                     enabled: bool) -> None:
    """Outputs are finite, and angle, reference and motor voltage within their limits, while faults begin and end."""
    changes: dict[str, Any] = {f"fault.{name}": value for name, value in sizes.items()}
    for name, (begin, length) in windows.items():
        changes |= {f"fault.{name}.begin": begin, f"fault.{name}.end": begin + length}
    parameters = load_parameters(model=f"{model}+faults")
    values = parameters.with_values(parameters.having(changes)).values
    step, acceleration = (1e-5, ELASTIC) if model in ("elastic", "ozkan") else (5e-5, RIGID)
    if model == "second-order":  # its equation from stop to stop: w_n^2 2 delta + 2 zeta w_n r
        w, zeta, r = (values[f"second_order.{name}"] for name in ("natural_frequency", "damping", "rate_limit"))
        acceleration = w**2 * 2.0 * values["fin.stop_angle"] + 2.0 * zeta * w * r
    run = simulate(values, 0.25, step, model=f"{model}+faults", fin_command=lambda t: command * sin(40.0 * t),
                   aero_torque=lambda t: load if t < 0.12 else -load, enable=lambda t: enabled or t > 0.1)
    assert all(np.isfinite(column).all() for column in run.values())
    rate, moved = np.abs(run["fin_rate"]), np.abs(np.diff(run["fin_angle"]))
    assert (moved <= step * np.maximum(rate[1:], rate[:-1]) + acceleration * step**2).all()
    assert np.abs(run["fin_angle"]).max() <= values["fin.stop_angle"] * (1.0 + 1e-12)
    if model != "second-order":
        assert np.abs(run["drive_reference"]).max() <= values["drive.reference_limit"]
        driven = run["motor_current"] != 0.0  # an open bridge shows the back-EMF
        if model != "ozkan":  # its current loop is ideal
            assert np.abs(run["motor_voltage"][driven]).max(initial=0.0) <= 39.0 * (1.0 + 1e-12)


@pytest.mark.parametrize("model", ["nonlinear", "elastic"])
def test_kernels_agree_and_states_restore_during_faults(model: str) -> None:
    """Bit for bit, with every fault in turn."""
    changes: dict[str, Any] = {}
    for i, fault in enumerate(possible(get(model))):
        changes |= {f"fault.{fault.name}.begin": 0.01 + 0.01 * i, f"fault.{fault.name}.end": 0.025 + 0.01 * i}
    name = f"{model}+faults"
    parameters = load_parameters(model=name)
    values = parameters.with_values(parameters.having(changes)).values
    python, compiled = codegen.core(values, name), CompiledCore(values, name)
    for k in range(1, 161):
        inputs = codegen.inputs_at_rest(wave(k * 1e-3), gust(k * 1e-3), 39.0)
        assert python.run(k * 1e-3 + 3e-4, inputs) == compiled.run(k * 1e-3 + 3e-4, inputs)
        if k % 20 == 0:
            state = python.state
            python = codegen.core(values, name)
            python.state = state
