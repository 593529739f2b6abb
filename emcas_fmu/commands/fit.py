"""`emcas fit`: fit the second-order model to the nonlinear actuator."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..actuators import NONLINEAR, full_name
from ..errors import EmcasError
from . import common

if TYPE_CHECKING:
    from ..parameters import ParameterSet

EPILOG = common.examples("fit", "", "-p my_actuator.toml --output my_second_order.toml", last=[
    "  python build_fmu.py --model second-order -p my_second_order.toml"])


def fit(
    parameters: common.ParametersOption = None,
    model: Annotated[str, common.value("Only the nonlinear actuator is fitted.", "NAME")] = NONLINEAR,
    output: Annotated[Path | None, common.output_option("Write a parameter file of the second-order model.")] = None,
    as_json: common.JsonOption = None,
) -> None:
    """Fit natural frequency, damping, rate limit and delay of the second-order model to the nonlinear one."""
    from ..studies import fitting

    common.check_outputs(output, as_json, inputs=(parameters,))
    fitted = fitting.fit(_nonlinear(parameters, model))
    common.warn(fitted.warnings)
    command = shlex.join(["emcas", "fit", *common.parameter_arguments(parameters)])
    common.write_results(fitted, (output, lambda each, path: fitting.write_fitted(each, path, command)))
    common.write_json(fitted.figures(), as_json)
    entries = {e.variable.name: e for e in fitted.parameters.entries}
    for name in fitting.NAMES:
        common.out.print(f"{name} = {entries[name].value:.4g} {entries[name].variable.unit}")
    common.conclude([common.table(["step / deg", "largest difference / %", "rms / %"], (
        [f"{size:g}", f"{largest:.2g}", f"{rms:.2g}"]
        for size, largest, rms in zip(fitted.sizes, fitted.largest, fitted.rms, strict=True)))], output)


def _nonlinear(files: list[Path] | None, model: str) -> ParameterSet:
    """Return the parameters of the nonlinear actuator. Raises EmcasError, in one line if they are those of another."""
    from ..parameters import ParameterError

    needs = "emcas fit needs the parameters of the nonlinear actuator"
    if full_name(model) != NONLINEAR:
        raise EmcasError(f"--model {model}: {needs}; leave --model out")
    try:
        return common.parameter_set(files)
    except ParameterError as error:
        unknown = [problem.partition(" = ")[0].rpartition(": ") for problem in error.problems
                  if ": unknown parameter" in problem]
        if len(unknown) < max(2, len(error.problems)):  # a misspelt name, or another mistake
            raise
        names = ", ".join(name for _, _, name in unknown)
        raise EmcasError(f"{unknown[0][0]}: {needs}, which has no {names}; give a file of that actuator") from error
