"""`python -m tests.ssp.run_in HOST SSP VARIANT MODE` runs an archive in a host and prints results.

In the modes ``open``, ``loop`` and ``wired`` it prints the outputs of every step as CSV. With ``open`` each fin has its
own command; with ``loop`` the command of fin 2 is the angle of fin 1 after the previous step; with ``wired`` a
connection of the archive does the same. With ``plain`` the host opens the file without the example's code, and some
parameters of each fin are printed; VARIANT is the parameter set for Ecos, or ``-``. Exit code 77: the host is not
installed.
"""

from __future__ import annotations

import sys
from pathlib import Path

from examples.ssp_hosts import hosts

STEPS = 300
ABSENT = 77
NAMES = ("mounting.azimuth", "friction.temperature", "friction.fin_coulomb", "supply_voltage")


def trajectory(host: str, ssp: str, variant: str, mode: str) -> None:
    """Print the trajectory of four fins with different commands, loads, a sagging bus and a switch-off."""
    with hosts.open(Path(ssp), host, variant, 1e-3) as system:
        print(",".join(["time", *system.outputs]))
        for i in (1, 2, 3, 4):
            if mode == "open" or i != 2:
                system.set(f"fin{i}.fin_command", 0.06 * i)
        for k in range(STEPS):
            if mode == "loop" and k:
                system.set("fin2.fin_command", system.get("fin1.fin_angle"))
            if k == 100:
                for i in (1, 2, 3, 4):
                    system.set(f"fin{i}.aero_torque", -15.0 * i)
                system.set("acceleration.x", 30.0)
            if k == 180:
                system.set("supply_voltage", 20.0)
            if k == 250:
                system.set("enable", False)
            system.step()
            print(",".join(repr(float(v)) for v in (system.time, *map(system.get, system.outputs))))


def plain_libcosim(ssp: str) -> None:
    """Print parameters in libcosim, which uses the archive's step size and parameter sets."""
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver

    log_output_level(CosimLogLevel.ERROR)
    execution, observer = CosimExecution.from_ssp_file(ssp), CosimObserver.create_last_value()
    assert execution.add_observer(observer)
    execution.step()
    assert execution.status().current_time == 1_000_000
    for i in (1, 2, 3, 4):
        index = execution.slave_index_from_instance_name(f"fin{i}")
        references = {v.name.decode(): v.reference for v in execution.slave_variables(index)}
        print(*map(repr, observer.last_real_values(index, [references[n] for n in NAMES])))


def plain_ecos(ssp: str, parameters: str) -> None:
    """Print parameters in Ecos, which uses a parameter set only on request."""
    from ecospy import EcosSimulation

    with EcosSimulation(ssp_path=ssp, step_size=1e-3) as simulation:
        assert simulation.init(parameter_set=None if parameters == "-" else parameters)
        simulation.step()
        for i in (1, 2, 3, 4):
            print(*(repr(simulation.get_real(f"fin{i}::{n}")) for n in NAMES))
        simulation.terminate()


def main(host: str, ssp: str, variant: str, mode: str) -> None:
    try:
        __import__(host)
    except (ImportError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(ABSENT)
    if mode != "plain":
        trajectory(host, ssp, variant, mode)
    elif host == "ecospy":
        plain_ecos(ssp, variant)
    else:
        plain_libcosim(ssp)


if __name__ == "__main__":
    main(*sys.argv[1:])
