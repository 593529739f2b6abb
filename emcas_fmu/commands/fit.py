"""`emcas fit`: fit the second-order model to the nonlinear actuator."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

from ..actuators import NONLINEAR, full_name
from ..errors import EmcasError
from ..pages.numbers import with_unit
from . import common

EPILOG = common.examples("fit", "", "-p my_actuator.toml --output my_second_order.toml", last=[
    "  python build_fmu.py --model second-order -p my_second_order.toml"])


def fit(
    parameters: common.ParametersOption = None,
    model: Annotated[str, common.value("Actuator to approximate; only nonlinear is possible.", "NAME")] = NONLINEAR,
    output: Annotated[Path | None, common.output_option("Write a parameter file for the second-order model.")] = None,
    as_json: common.JsonOption = None,
) -> None:
    """Fit natural frequency, damping, rate limit and delay of the second-order model to the nonlinear actuator."""
    from ..studies import fitting

    common.check_outputs(output, as_json, inputs=(parameters,))
    if full_name(model) != NONLINEAR:
        raise EmcasError(f"--model {model}: emcas fit needs the parameters of the nonlinear actuator; leave --model "
                         "out")
    fitted = fitting.fit(common.nonlinear_set(parameters, "emcas fit"))
    common.warn(fitted.warnings)
    command = shlex.join(["emcas", "fit", *common.parameter_arguments(parameters)])
    common.write_results(fitted, (output, lambda each, path: fitting.write_fitted(each, path, command)))
    common.write_json(fitted.figures(), as_json)
    entries = {e.variable.name: e for e in fitted.parameters.entries}
    for name in fitting.FITTED:
        common.out.print(f"{name} = {with_unit(entries[name].value, entries[name].variable.unit)}")
    common.conclude([common.table(["step / deg", "largest difference / %", "rms / %"], (
        [f"{size:g}", f"{largest:.2g}", f"{rms:.2g}"]
        for size, largest, rms in zip(fitted.sizes, fitted.largest, fitted.rms, strict=True)))], output)
