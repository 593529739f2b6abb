"""Time histories of samples. Rows contain figures only; for its history a sample is run again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ...bench.subject import Subject
from ...errors import EmcasError
from ...fmi.interface import FmuInterface
from ...parameters import load_parameters
from ...response import Response
from .experiments import Experiment, excitation
from .plan import Plan


def history(plan: Plan, experiment: Experiment, drawn: Sequence[float], subject: Subject) -> Response:
    """Return all outputs of a sample, whose factors have the values `drawn`, in an experiment.

    The history of a sample that failed ends there. Raises EmcasError if there is none.
    """
    values, numbers = plan.varied(drawn)
    changes = {name: value for name, value in values.items() if value != subject.values[name]}
    run = subject.run(excitation(experiment, values, numbers, plan.model), changes)
    rows = len(run.columns["time"])
    if rows < 2:
        raise EmcasError(f"experiment {experiment.name}: there is no history; {'; '.join(run.messages) or run.reason}")
    followed = replace(run.excitation, title=f"{experiment.name}: {run.excitation.title}", columns={
        name: column[:rows] for name, column in run.excitation.columns.items()})
    parameters = load_parameters(model=plan.model).with_values(values)
    return Response(FmuInterface(1, plan.model), (parameters,), followed, run.columns)
