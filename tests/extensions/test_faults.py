"""Faults: their times, models without an active fault, and faults that equal a change of the plain model."""

from __future__ import annotations

from math import pi, radians
from typing import Any

import numpy as np
import pytest

from emcas_fmu.actuators import NAMES, get
from emcas_fmu.actuators.capabilities import BACKLASH
from emcas_fmu.extensions.fault_list import FAULTS, LONGEST_COMMAND_DELAY
from emcas_fmu.extensions.status import OPERATIONAL
from emcas_fmu.parameters import ParameterError, load_parameters
from emcas_fmu.runtime import codegen
from emcas_fmu.simulation import simulate, simulate_fins
from tests.default_actuator import EVERY
from tests.marks import others_slow
from tests.runs import assert_equal

from .fault_runs import BASE, BIT, MODEL, PLAIN, bits_of, gust, scheduled, wave

ELASTIC = "elastic+faults"
QUICK = others_slow(NAMES, lambda name: name not in ("habibi", "worm-gear", "worm-gear-elastic"))
# The general faults that an actuator cannot have; it has the others, each with the same bit as in every actuator.
WINDING = ("winding_short", "phase_loss")
IMPOSSIBLE = {
    "nonlinear": {"backlash_growth"}, "elastic": set(), "habibi": set(), "ozkan": {*WINDING, "backlash_growth"},
    "ristanovic": {*WINDING, "backlash_growth", "current_derating"},
    "worm-gear": {"backlash_growth"}, "worm-gear-elastic": set(),
    "linear": {"backlash_growth", "current_derating", "hard_over"},
    "clutch": {*WINDING, "backlash_growth", "current_derating"}, "series-clutch": {*WINDING, "backlash_growth"},
    "servo": {*WINDING, "backlash_growth", "current_derating", "free_fin", "friction_rise"},
    "electrohydrostatic": {*WINDING, "backlash_growth", "free_fin", "friction_rise"},
    "electrohydraulic": {*WINDING, "backlash_growth", "current_derating", "free_fin", "friction_rise"},
    "second-order": {*WINDING, "backlash_growth", "current_derating", "brown_out", "free_fin", "friction_rise"}}

# The bits of `fault_word`, the lowest first: a host reads them by number. A new general fault is the last of these, and
# moves the bits of the faults that actuators declare, which follow.
GENERAL = ("jam", "free_fin", "hard_over", "drive_loss", "current_derating", "brown_out", "encoder_freeze",
           "encoder_bias", "encoder_dropped", "encoder_reversed", "command_freeze", "command_delay", "friction_rise",
           "backlash_growth", "winding_short", "phase_loss")
OF_WORM = ("lost_lock", "dry_flanks")
OF_CLUTCH = ("drag", "powder_loss", "coil_open", "coil_short", "overheating")
OF_KIND = {
    "worm-gear": OF_WORM, "worm-gear-elastic": OF_WORM, "clutch": (*OF_CLUTCH, "both_engaged"),
    "series-clutch": (*OF_CLUTCH, "clutch_engaged"),
    "servo": ("stripped_gear", "worn_gear", "demagnetised", "dry_gear"),
    "electrohydrostatic": ("leakage", "reservoir_loss", "air", "relief_open", "bypass_open", "pump_seized"),
    "electrohydraulic": ("silting", "internal_leakage", "air")}


@pytest.mark.parametrize("model", NAMES)
def test_bits_of_the_fault_word_keep_their_meaning(model: str) -> None:
    (word,) = (v for v in get(f"{model}+faults").outputs if v.name == "fault_word")
    assert word.bits == (*GENERAL, *OF_KIND.get(model, ()))


@pytest.mark.parametrize("model", EVERY)
def test_an_actuator_has_every_possible_fault(model: str) -> None:
    faults = {name.split(".")[1] for name in load_parameters(model=f"{model}+faults").values
              if name.endswith(".active")}
    bit = bits_of(model)
    assert faults == set(bit) - IMPOSSIBLE[model]
    for fault in faults:
        run = simulate(scheduled(f"{model}+faults", fault), 0.005, model=f"{model}+faults")
        assert (run["fault_word"][1:] == bit[fault]).all()


@pytest.mark.parametrize("model", QUICK)
def test_a_bias_is_added_to_the_measured_angle(model: str) -> None:
    """At rest, for any ratio, to one count of encoder (1.3e-5 rad at the fin) or transducer, or to the gap."""
    values = scheduled(f"{model}+faults", "encoder_bias", begin=0.1, fault__encoder_bias__angle=0.05)
    run = simulate(values, 2.0, model=f"{model}+faults", fin_command=0.2)
    count = 2.0 * pi / values["encoder.counts"] if "encoder.counts" in values else 1.3e-5
    assert run["measured_fin_angle"][-1] - run["fin_angle"][-1] == pytest.approx(
        0.05, abs=1e-3 if BACKLASH in get(model).provides else values.get("transducer.resolution", count))


@pytest.mark.parametrize("model", QUICK)
def test_without_an_active_fault_no_bit_changes(model: str) -> None:
    inputs: dict[str, Any] = {"fin_command": wave,  # 40 N.m are beyond the servo's stall torque
                              "aero_torque": (lambda t: 0.1 * gust(t)) if model == "servo" else gust}
    plain = simulate(load_parameters(model=model).values, 0.4, model=model, **inputs)
    values = load_parameters(model=f"{model}+faults").values
    run = simulate(values, 0.4, model=f"{model}+faults", **inputs)
    assert_equal(run, plain)
    assert not run["fault_word"].any()
    assert not run["built_in_test"].any()
    assert (run["status"] == OPERATIONAL).all()


# -- begin and end --------------------------------------------------------------------

@pytest.mark.parametrize("fault", [f.name for f in FAULTS])
def test_an_active_fault_is_one_scheduled_from_the_start(fault: str) -> None:
    model = ELASTIC if fault == "backlash_growth" else MODEL
    active = load_parameters(model=model).with_values({f"fault.{fault}.active": True}).values
    runs = [simulate(values, 0.15, model=model, fin_command=wave, aero_torque=gust)
            for values in (active, scheduled(model, fault))]
    assert_equal(*runs)
    assert (runs[0]["fault_word"][1:] == BIT[fault]).all()


def test_a_fault_begins_and_ends_with_samples() -> None:
    """It lasts from the first sample at or after its begin to the last before its end.

    A row shows the samples before it.
    """
    run = simulate(scheduled(MODEL, "command_freeze", begin=0.0105, end=0.020), 0.03, model=MODEL)
    active = run["fault_word"] == BIT["command_freeze"]
    np.testing.assert_array_equal(np.flatnonzero(active), np.arange(12, 21))  # samples at 11 to 19 ms


def test_a_rounded_begin_means_its_sample() -> None:
    """Hosts add up sample times, and 0.1 + 0.1 + 0.1 is not 0.3 in floating point."""
    for sample in (3, 7, 29, 113):
        begin = sum(1e-3 for _ in range(sample))
        run = simulate(scheduled(MODEL, "jam", begin=begin), 0.12, model=MODEL)
        assert np.flatnonzero(run["fault_word"])[0] == sample + 1


# -- each against the plain model with equivalent settings ---------------------------

def test_derating_is_a_lower_current_limit() -> None:
    # The controllers' anti-windup would use the limit without the fault.
    no_antiwindup = {"controller.drive_antiwindup": 0.0}
    derated = {**scheduled(MODEL, "current_derating", fault__current_derating__share=0.2), **no_antiwindup}
    lower = PLAIN.with_values({"drive.current_limit": 0.2 * PLAIN.values["drive.current_limit"], **no_antiwindup})
    assert_equal(simulate(derated, 0.3, model=MODEL, fin_command=radians(15.0)),
                 simulate(lower.values, 0.3, fin_command=radians(15.0)))


def test_brown_out_is_a_lower_supply_voltage() -> None:
    run = simulate(scheduled(MODEL, "brown_out", fault__brown_out__share=0.5), 0.3, model=MODEL,
                   fin_command=radians(15.0))
    lower = simulate(PLAIN.values, 0.3, fin_command=radians(15.0), supply_voltage=19.5)
    # The line supplies the drive's current at its own voltage, and receives the power that the drive returns. The first
    # row is before the first sample and the fault.
    power = lower["supply_power"][1:]
    assert power.min() < 0.0 < power.max()
    power[power > 0.0] *= 2.0
    assert_equal(run, lower)


def test_a_pressure_line_supplies_the_flow_of_a_fin_in_a_brown_out() -> None:
    """With one sound fin and one whose supply is halved, flows add up, and power is flow times the line's own pressure.

    The line receives the power that returns through the drop, but half of the flow.
    """
    model = "electrohydraulic+faults"
    values = load_parameters(model=model).values
    weak = {**values, "fault.brown_out.active": True, "fault.brown_out.share": 0.5}
    run = simulate_fins([values, weak], 0.05, model=model, line={"line.accumulator_volume": 1e-4},
                        fin_command=lambda t: radians(10.0) if t > 0.005 else 0.0)
    flows = [run[f"fin[{k}].supply_flow"] for k in (1, 2)]
    assert max(flows[1]) > 1e-5
    flows[1] = np.where(flows[1] > 0.0, flows[1], 0.5 * flows[1])
    # Sums and quotients of a few numbers in another order round differently.
    np.testing.assert_allclose(run["line_flow"], flows[0] + flows[1], rtol=1e-12)
    np.testing.assert_allclose(run["supply_power"], run["line_pressure"] * run["line_flow"], rtol=1e-12)
    np.testing.assert_allclose(run["fin[2].supply_power"], run["line_pressure"] * flows[1], rtol=1e-12)


def test_a_bus_supplies_the_current_of_a_drive_in_a_brown_out() -> None:
    values = load_parameters(model=MODEL).values
    weak = {**values, "fault.brown_out.active": True, "fault.brown_out.share": 0.6}
    run = simulate_fins([values, weak], 0.1, model=MODEL, line={"bus.source_resistance": 0.02}, aero_torque=60.0,
                        fin_command=lambda t: radians(15.0) if t > 0.005 else 0.0)
    sound, sagged = (run[f"fin[{k}].motor_voltage"] * run[f"fin[{k}].motor_current"] for k in (1, 2))
    sagged = np.where(sagged > 0.0, sagged / 0.6, sagged)
    assert sagged.min() < -1.0
    assert sagged.max() > 1.0
    np.testing.assert_allclose(run["bus_current"][1:], ((sound + sagged) / run["bus_voltage"])[1:], rtol=1e-12)


def test_friction_rise_is_more_friction() -> None:
    factor = 2.5
    more = {name: factor * value for name, value in PLAIN.values.items()
            if name.startswith(("friction.viscous", "friction.coulomb", "friction.fin"))}
    for name in ("friction.fin_viscous", "friction.fin_coulomb"):
        more[name] = factor * 2.0
    # The controller would compensate for the friction without the fault.
    risen = scheduled(MODEL, "friction_rise", compensation__gain=0.0, friction__fin_viscous=2.0,
                      friction__fin_coulomb=2.0, fault__friction_rise__factor=factor)
    plain = PLAIN.with_values({**more, "compensation.gain": 0.0}).values
    assert_equal(simulate(risen, 0.3, model=MODEL, fin_command=wave), simulate(plain, 0.3, fin_command=wave))


def test_backlash_growth_is_a_wider_gap() -> None:
    plain = load_parameters(model="elastic")
    gap = plain.values["drive_line.backlash"]
    run = simulate(scheduled(ELASTIC, "backlash_growth", fault__backlash_growth__gap=0.2e-3), 0.2, model=ELASTIC,
                   fin_command=wave)
    wider = plain.with_values({"drive_line.backlash": gap + 0.2e-3}).values
    assert_equal(run, simulate(wider, 0.2, model="elastic", fin_command=wave))


def test_a_grown_gap_does_not_heal() -> None:
    assert_equal(*(simulate(scheduled(ELASTIC, "backlash_growth", begin=0.02, end=end), 0.2, model=ELASTIC,
                            fin_command=wave) for end in (0.05, 1e9)))


@pytest.mark.parametrize(("model", "amount"), [
    (f"{name}+faults", "backlash_growth.gap") for name in ("elastic", "worm-gear-elastic")] + [
    ("servo+faults", "worn_gear.angle")])
def test_a_gap_that_has_grown_does_not_close_when_its_amount_falls(model: str, amount: str) -> None:
    """A gap that closes would push the drive line apart: energy from nowhere."""
    p = load_parameters(model=model).with_values({f"fault.{amount.split('.')[0]}.active": True})
    core, other = (codegen.core(p.values, model) for _ in range(2))
    inputs = codegen.inputs_at_rest(0.1, 5.0, 28.0)
    for number in range(1, 11):
        core.run(0.02 * number, inputs)
        other.run(0.02 * number, inputs)
    other.bind(codegen.bound_functions(p.with_values({f"fault.{amount}": 0.0}).values, model))
    assert [core.run(0.2 + 0.01 * k, inputs) for k in range(1, 6)] == [
        other.run(0.2 + 0.01 * k, inputs) for k in range(1, 6)]


@pytest.mark.parametrize("amount", ["current_derating.share", "brown_out.share", "friction_rise.factor"])
def test_a_changed_amount_acts_at_once(amount: str) -> None:
    """Within a sample, during a slew in which the current is at its limit; only if the fault is active."""
    outputs = {}
    for active in (False, True):
        p = load_parameters(model=ELASTIC).with_values({f"fault.{amount.split('.')[0]}.active": active})
        core, other = (codegen.core(p.values, ELASTIC) for _ in range(2))
        inputs = codegen.inputs_at_rest(0.3, 0.0, 39.0)
        assert core.run(0.0202, inputs) == other.run(0.0202, inputs)
        changed = p.with_values({f"fault.{amount}": 0.7 * p.values[f"fault.{amount}"]})
        other.bind(codegen.bound_functions(changed.values, ELASTIC))
        outputs[active] = core.run(0.0208, inputs), other.run(0.0208, inputs)
    assert outputs[False][0] == outputs[False][1]
    assert outputs[True][0] != outputs[True][1]


def test_loss_of_drive_is_an_open_bridge() -> None:
    """The plant is that of a disabled drive; the controller is unaware and computes on."""
    run = simulate(scheduled(MODEL, "drive_loss", begin=0.1), 0.3, model=MODEL, fin_command=wave, aero_torque=gust)
    plain = simulate(PLAIN.values, 0.3, fin_command=wave, aero_torque=gust, enable=lambda t: t < 0.0999)
    assert_equal(run, {name: plain[name] for name in ("fin_angle", "fin_rate", "motor_current", "motor_voltage",
                                                      "supply_power")})
    assert not np.array_equal(run["drive_reference"], plain["drive_reference"])


def test_freeze_of_the_command() -> None:
    run = simulate(scheduled(MODEL, "command_freeze", begin=0.1), 0.3, model=MODEL, fin_command=wave)
    plain = simulate(PLAIN.values, 0.3, fin_command=lambda t: wave(min(t, 0.099)))
    del plain["tracking_error"]  # the error of the new command
    assert_equal(run, plain)


@pytest.mark.parametrize(("delay", "samples"), [(0.0, 0), (7.4e-3, 7), (50e-3, LONGEST_COMMAND_DELAY)])
def test_delay_of_the_command(delay: float, samples: int) -> None:
    run = simulate(scheduled(MODEL, "command_delay", fault__command_delay__time=delay), 0.3, model=MODEL,
                   fin_command=wave)
    plain = simulate(PLAIN.values, 0.3, fin_command=lambda t: wave(t - samples * 1e-3) if t > (samples - 0.5) * 1e-3
                     else 0.0)
    for name in ("fin_angle", "motor_current", "drive_reference"):
        # The times of both sines are k T less n T and (k - n) T, which round differently.
        np.testing.assert_allclose(run[name], plain[name], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(("name", "value", "message"), [
    ("fault.brown_out.share", 1.5, r"must be within 0 \.\. 1"),
    ("fault.friction_rise.factor", 0.5, r"must be within 1 \.\. 10000"),
    ("fault.hard_over.share", "2", r"must be within -1 \.\. 1"),
    ("fault.command_delay.time", "5 m", "s"),
    ({"fault.command_delay.time": 0.06, "fault.command_delay.active": True}, None, "0.06 s must be at most 50 times"),
    ({"fault.command_delay.time": 0.06, "fault.command_delay.end": 1.0}, None, "controller.sample_time = 0.001 s"),
    ("fault.jam.active", 1.0, "expected true or false"),
    ("monitor.persistence", -1.0, "must be within 0"),
    ("fault.jamm.active", True, "did you mean"),
])
def test_bad_values_are_refused(name: Any, value: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        BASE.with_values({name: value} if isinstance(name, str) else name)


def test_a_model_without_the_extension_has_no_fault_parameter() -> None:
    with pytest.raises(ParameterError, match="the nonlinear actuator has no such parameter"):
        PLAIN.with_values({"fault.jam.active": True})
