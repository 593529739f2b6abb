"""What a host makes of the archive by itself: `python -m tests.ssp.plain_in HOST SSP SET`; prints some parameters.

SET is the parameter set Ecos is asked for, or ``-``. Exit code 77: the host is not installed.
"""

from __future__ import annotations

import sys

ABSENT = 77
NAMES = ("mounting.azimuth", "friction.temperature", "friction.fin_coulomb", "supply_voltage")
FINS = ("fin1", "fin2", "fin3", "fin4")


def in_libcosim(ssp: str, _: str) -> None:
    """Step size and parameters are those of the archive."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    execution, observer = CosimExecution.from_ssp_file(ssp), CosimObserver.create_last_value()
    assert execution.add_observer(observer)
    execution.step()
    assert execution.status().current_time == 1_000_000
    for fin in FINS:
        index = execution.slave_index_from_instance_name(fin)
        references = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
        print(*map(repr, observer.last_real_values(index, [references[n] for n in NAMES])))


def in_ecos(ssp: str, parameters: str) -> None:
    """The parameter set has to be asked for."""
    from ecospy import EcosSimulation

    with EcosSimulation(ssp_path=ssp, step_size=1e-3) as simulation:
        assert simulation.init(parameter_set=None if parameters == "-" else parameters)
        simulation.step()
        for fin in FINS:
            print(*(repr(simulation.get_real(f"{fin}::{n}")) for n in NAMES))
        simulation.terminate()


if __name__ == "__main__":
    try:
        __import__(sys.argv[1])
    except (ImportError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(ABSENT)
    {"libcosimpy": in_libcosim, "ecospy": in_ecos}[sys.argv[1]](*sys.argv[2:])
