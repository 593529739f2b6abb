"""`python -m tests.ssp.run_in HOST SSP VARIANT MODE` prints the outputs of every step of an archive in a host as CSV.

Modes: ``open`` sets inputs of its own; ``loop`` gives fin 2 what fin 1's angle was at the end of the step before;
``wired`` leaves that to the archive. Exit code 77: the host is not installed.
"""

from __future__ import annotations

import sys
from pathlib import Path

from examples.ssp_hosts import hosts

STEPS = 300
ABSENT = 77


def main(host: str, ssp: str, variant: str, mode: str) -> None:
    """Print the trajectory of four fins with commands of their own, loads, a sagging bus and a switch-off."""
    try:
        __import__(host)
    except (ImportError, OSError) as error:
        print(f"{type(error).__name__}: {error}", file=sys.stderr)
        sys.exit(ABSENT)
    with hosts.open(Path(ssp), host, variant, 1e-3) as system:
        print(",".join(["time", *system.outputs]))
        for i in (1, 2, 3, 4):
            if mode == "open" or i != 2:
                system.set(f"fin[{i}].fin_command", 0.06 * i)
        for k in range(STEPS):
            if mode == "loop" and k:
                system.set("fin[2].fin_command", system.get("fin[1].fin_angle"))
            if k == 100:
                for i in (1, 2, 3, 4):
                    system.set(f"fin[{i}].aero_torque", -15.0 * i)
                system.set("acceleration.x", 30.0)
            if k == 180:
                system.set("supply_voltage", 20.0)
            if k == 250:
                system.set("enable", False)
            system.step()
            print(",".join(repr(float(v)) for v in (system.time, *map(system.get, system.outputs))))


if __name__ == "__main__":
    main(*sys.argv[1:])
