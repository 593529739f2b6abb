"""Run `emcas` in the process of the test."""

from __future__ import annotations

from typer.testing import CliRunner, Result

from emcas_fmu.cli import app


def emcas(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def refusal(*arguments: object) -> str:
    """Return the error message of a command, on one line; its exit code must be 2."""
    done = emcas(*arguments)
    assert done.exit_code == 2, done.output
    return " ".join(done.stderr.split())
