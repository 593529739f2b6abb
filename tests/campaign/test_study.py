"""Campaign files: their meaning, and errors that name the entry and the remedy."""

from __future__ import annotations

import re
from contextlib import suppress
from math import radians
from pathlib import Path

import pytest

from emcas_fmu.errors import EmcasError
from emcas_fmu.motions import LEAD_IN, MOTIONS
from emcas_fmu.parameters import load_parameters
from emcas_fmu.studies.campaign.distributions import CampaignError
from emcas_fmu.studies.campaign.experiments import excitation
from emcas_fmu.studies.campaign.study import Campaign, load_study
from emcas_fmu.support.files import models_directory
from tests.default_actuator import FILE_ENTRIES
from tests.marks import slow

from .conftest import GRID, ODD, SMALL, Write, campaign, replaced


def test_shipped_campaign_is_valid(write: Write, tmp_path: Path) -> None:
    study = load_study(models_directory() / "campaign.toml")
    assert study.samples == 1000
    assert {e.kind for e in study.experiments} == {"step", "sweep"}
    (tmp_path / "half.toml").write_text('[drive]\nsupply_voltage = "19.5 V"\n', encoding="utf-8")
    half = load_study(write(f'[base]\nparameters = "{tmp_path / "half.toml"}"\n{study.text}'))
    for each, limits in ((study, (18.0, 39.0)), (half, (9.0, 19.5))):  # the sag is a percentage of the supply voltage
        sag = next(f for f in each.factors if f.name == "experiments.sag.inputs.supply_voltage.value")
        assert sag.distribution.limits() == limits


def test_numbers_of_a_study_have_the_units_of_the_table(small: Campaign) -> None:
    constant, temperature, load = (f.distribution.numbers for f in small.factors)
    base = load_parameters().values["motor.torque_constant"]
    # The default mean is the base value; a percentage of an sd is relative to the mean (one rounding).
    assert constant == pytest.approx({"mean": base, "sd": 0.03 * base}, rel=1e-15)
    assert temperature == {"low": -6.0, "high": 24.0}
    assert load == {"low": -40.0, "high": 0.0}
    assert small.numbers == {"experiments.step.amplitude": radians(5.0)}


@pytest.mark.parametrize(("written", "expected"), [("5 K", 5.0), ("5 degC", 5.0), ("9 degF", 5.0)])
def test_standard_deviation_of_a_temperature_is_a_difference(write: Write, written: str, expected: float) -> None:
    text = SMALL.replace('"uniform"\nlow = "-6 degC"\nhigh = "24 degC"',
                         f'"normal"\nmean = "10 degC"\nsd = "{written}"')
    factor = load_study(write(text)).factors[1]
    # Two numbers near 273.15 are subtracted: a few roundings of 3e-14.
    assert factor.distribution.numbers["sd"] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(("low", "high", "warned"), [
    ("-6 degC", "24 degC", ()), ("-40 degC", "80 degC", ("-40",)), ("0 degC", "30 degC", ("30",)),
    ("-60 degC", "-20 degC", ("-40",)),  # the median is warned of first
])
def test_warning_if_a_drawn_temperature_is_outside_the_tested_range_of_friction(
        write: Write, low: str, high: str, warned: tuple[str, ...]) -> None:
    """The base value of a temperature that varies gives no warning."""
    text = SMALL.replace('low = "-6 degC"\nhigh = "24 degC"', f'low = "{low}"\nhigh = "{high}"')
    (write(SMALL).parent / "cold.toml").write_text('friction.temperature = "-50 degC"\n', encoding="utf-8")
    study = load_study(write('[base]\nparameters = "cold.toml"\n' + text))
    assert [message.partition(" is outside")[0] for message in study.warnings] == [
        f"friction.temperature = {value} degC" for value in warned]


def test_warning_if_the_constant_temperature_is_outside_the_tested_range(write: Write) -> None:
    varied = '[vary."friction.temperature"]\ndistribution = "uniform"\nlow = "-6 degC"\nhigh = "24 degC"\n'
    assert varied in SMALL
    file = write('[base]\nparameters = "cold.toml"\n' + SMALL.replace(varied, ""))
    (file.parent / "cold.toml").write_text('friction.temperature = "-50 degC"\n', encoding="utf-8")
    result = campaign(file, "--only", 0)
    assert result.exit_code == 0
    assert result.stderr.count("warning: friction.temperature = -50 degC is outside") == 1


def test_parameter_that_follows_another_keeps_its_ratio(small: Campaign) -> None:
    values, _ = small.varied([1.5 * small.base["motor.torque_constant"], 0.0, 0.0])
    assert values["motor.back_emf_constant"] == pytest.approx(1.5 * small.base["motor.back_emf_constant"], rel=1e-15)


def test_any_parameter_may_vary(write: Write) -> None:
    """Every number and switch of the table can be a factor at its base value, except temperatures."""
    base = load_parameters().values
    temperatures = {v.name for v in FILE_ENTRIES if v.unit == "degC"}
    levels = {name: str(value).lower() if isinstance(value, bool) else '"100 %"' for name, value in base.items()
              if name not in temperatures}
    entries = [f'[vary."{name}"]\nlevels = [{level}]' for name, level in levels.items()]
    text = '[campaign]\nmethod = "grid"\n[experiments.a]\nkind = "hold"\namplitude = "0 deg"\n' + "\n".join(entries)
    study = load_study(write(text))
    assert len(study.factors) == len(base) - len(temperatures)
    assert study.samples == 1
    assert {f.name: f.value(float(f.distribution.at(0.5))) for f in study.factors} == {
        name: value for name, value in base.items() if name not in temperatures}


def test_inputs_of_an_experiment_apply_to_it_alone(write: Write) -> None:
    text = SMALL + """
[experiments.step.inputs.supply_voltage]
kind = "window"
value = "50 %"
begin = "20 ms"
end = "30 ms"

[experiments.step.inputs.enable]
kind = "window"
value = false
begin = "-10 ms"
end = "5 ms"

[experiments.quiet]
kind = "hold"
amplitude = "1 deg"
duration = "0.2 s"
"""
    study = load_study(write(text))
    step, quiet = study.experiments
    numbers = {**study.numbers, "inputs.aero_torque.value": -7.0}
    first = excitation(step, study.base, numbers, study.model)
    supply, time = first.columns["supply_voltage"], first.time - LEAD_IN
    low = (time > 0.0195) & (time < 0.0295)
    assert set(supply[low]) == {19.5}
    assert set(supply[~low]) == {39.0}
    off = (time > -0.0105) & (time < 0.0045)
    assert (first.columns["enable"] == ~off).all()
    assert set(first.columns["aero_torque"]) == {-7.0}
    assert set(first.command[time < -1e-9]) == {0.0}
    assert set(first.command[time > -1e-9]) == {radians(5.0)}
    assert first.begin == LEAD_IN
    other = excitation(quiet, study.base, numbers, study.model)
    assert set(other.columns) == {"fin_command", "aero_torque"}
    assert set(other.columns["aero_torque"]) == {-7.0}
    assert set(other.command) == {radians(1.0)}


@pytest.mark.parametrize(("before", "after", "message"), [
    ("motor.torque_constant\"]\ndis", "motor.torque_konstant\"]\ndis", "did you mean motor.torque_constant"),
    ("[vary.\"friction", "[vary.motor.torque_constant]\nsd = 1\n[vary.\"friction", "appears twice"),
    ("aero_torque]", "aero_tork]", "did you mean aero_torque"),
    ("aero_torque]", "fin_command]", "the experiment determines the command"),
    ('"normal"', '"norml"', "did you mean normal"),
    ('sd = "3 %"', 'sdd = "3 %"', "unknown key 'sdd'; did you mean sd"),
    ('sd = "3 %"', 'sd = "0 %"', "must be above 0"),
    ('sd = "3 %"', 'sd = "3 kg"', "vary.motor.torque_constant.sd = 3 kg"),
    ('sd = "3 %"', 'sd = "60 %"', "use distribution = \"truncated-normal\""),
    ('sd = "3 %"', "", "sd is missing"),
    ('"uniform"\nlow = "-6 degC"\nhigh = "24 degC"', '"normal"\nmean = "10 degC"\nsd = "10 %"',
     "write a difference such as 5 K"),
    ('"uniform"\nlow = "-6 degC"\nhigh = "24 degC"', '"choice"\nlevels = ["1 degC"]\nweights = [inf]',
     "weights must be 1 finite numbers above 0"),
    ('"constant"\nvalue =', '"window"\nbegin = "30 ms"\nend = "10 ms"\nvalue =',
     "end = 0.01 s is before begin = 0.03 s"),
    ('"constant"\nvalue =', '"window"\nbegin = { low = "30 ms", high = "50 ms", count = 3 }\nend = "20 ms"\nvalue =',
     "end = 0.02 s is before begin = 0.03 s"),
    ('kind = "step"', 'kind = "sweep"\nlow = "20 Hz"\nhigh = "20 Hz"', "low (at most 20 Hz) must be below high"),
    ('kind = "step"', 'kind = "chirp"\nlow = "20 Hz"\n'
     'high = { distribution = "uniform", low = "15 Hz", high = "30 Hz" }', "must be below high (at least 15 Hz"),
    ("[campaign]", '[base]\nfin = 2\n[campaign]', "fin 2 must be a fin of an FMU"),
    ("[campaign]", '[base]\nfin = 0\n[campaign]', "base.fin = 0"),
    ('low = "-6 degC"', 'low = "50 degC"', "must be below high"),
    ('low = "-6 degC"', 'low = "-150 degC"', "must stay within -100 .. 200 degC"),
    ('low = "-6 degC"', 'low = "50 %"', "a percentage of a temperature has no meaning"),
    ('follows = "motor.torque_constant"', 'follows = "motor.resistance"', "is not a real number that varies"),
    ('kind = "constant"', 'kind = "konstant"', "did you mean constant"),
    ('kind = "step"', 'kind = "leap"', f"there is {', '.join(MOTIONS)}"),
    ('amplitude = "5 deg"', 'amplitude = "5 V"', "experiments.step.amplitude = 5 V"),
    ('amplitude = "5 deg"', 'amplitude = "50 deg"', "must be within"),
    ('amplitude = "5 deg"', 'amplitude = "0 deg"', "must not be 0"),
    ('amplitude = "5 deg"', "", "amplitude is missing"),
    ('duration = "0.3 s"', 'duration = "0.3"', "has no unit"),
    ('duration = "0.3 s"', 'duration = "400 s"', "must be within 0.01 .. 300 s"),
    ('duration = "0.3 s"', 'duration = "0.30005 s"', "whole number of milliseconds"),
    ("samples = 24", "samples = 0", "campaign.samples = 0"),
    ("seed = 5", "seed = -1", "campaign.seed = -1"),
    ("seed = 5", 'seed = 5\nmethod = "quasi"', "campaign.method = quasi"),
    ("seed = 5", 'seed = 5\nmethod = "grid"', "a grid needs levels"),
    ("[campaign]", "[base]\nparameters = 3\n[campaign]", "base.parameters = 3: must be the name of a file"),
    ("[campaign]", "[base]\nparameters = \"none.toml\"\n[campaign]", "none.toml: cannot be read"),
    ("[campaign]", "[base]\nfmu = \"none.fmu\"\n[campaign]", "none.fmu: there is no such file"),
    ("[campaign]", "[campaing]\n[campaign]", "did you mean campaign"),
    ("[campaign]", "[campaign", "is not valid TOML"),
])
def test_refusals_name_the_entry(write: Write, before: str, after: str, message: str) -> None:
    assert before in SMALL
    path = write(SMALL.replace(before, after, 1))
    with pytest.raises(EmcasError, match=re.escape(message)):
        load_study(path)


def test_error_lists_all_problems(write: Write) -> None:
    text = SMALL.replace("samples = 24", "samplez = 24").replace("seed = 5", "seed = true")
    with pytest.raises(CampaignError) as caught:
        load_study(path := write(text))
    assert str(caught.value).splitlines() == [
        f"{path}: campaign.seed = true: expected a whole number",
        f"{path}: campaign: unknown key 'samplez'; did you mean samples?; there is samples, seed, method"]
    text = SMALL.replace('sd = "3 %"', "").replace('"-40 N.m"', '"-40 V"').replace('"5 deg"', '"5 deg"\nlast = 1')
    with pytest.raises(CampaignError) as caught:
        load_study(write(text))
    assert str(caught.value).splitlines() == [
        f"{path}: vary.motor.torque_constant: sd is missing; there is distribution, mean, sd",
        f"{path}: inputs.aero_torque.value.low = -40 V: the unit V does not measure this quantity; expected a number "
        "with a unit such as N.m",
        f"{path}: experiments.step: unknown key 'last'; there is kind, amplitude, duration, inputs"]


@pytest.mark.parametrize("odd", [*ODD[::2], *slow(*ODD[1::2])], ids=str)
def test_odd_value_at_any_position_gives_no_traceback(write: Write, odd: str) -> None:
    for text in replaced(SMALL, odd):
        with suppress(EmcasError):
            load_study(write(text))


def test_combination_that_is_always_invalid_is_refused(write: Write) -> None:
    text = SMALL + '[vary."fin.stop_angle"]\nlevels = ["10 deg"]\n'
    with pytest.raises(CampaignError, match=r"at their medians: fin\.stop_angle"):
        load_study(write(text))


def test_grid_has_the_product_of_its_levels(write: Write) -> None:
    study = load_study(write(GRID))
    assert study.samples == 24
    # Floating-point sums of 0.1/3: one or two roundings.
    assert study.factors[0].distribution.levels == pytest.approx((0.2, 0.7 / 3, 0.8 / 3, 0.3), rel=1e-15)
    with pytest.raises(CampaignError, match="the grid has 24 points"):
        load_study(write(GRID.replace('"grid"', '"grid"\nsamples = 7')))
