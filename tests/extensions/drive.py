"""Run an unpacked FMU in a separate process: `python -m tests.extensions.drive FOLDER SCRIPT` prints its outputs.

SCRIPT is JSON: {"start": {name: value}, "size": s, "steps": n, "set": [[step, name, value], ...], "restore": step}. At
the step `restore` another instance continues from the serialized state.
"""

from __future__ import annotations

import json
import sys

from tests.fmu.host import OK, Fmu, Instance


def main(folder: str, script: str) -> None:
    run = json.loads(script)
    fmu = Fmu(folder)
    instance = Instance(fmu)
    assert max(instance.initialize(**run["start"])) == OK, instance.log
    rows = []
    for k in range(run["steps"]):
        for step, name, value in run["set"]:
            if step == k:
                assert instance.set(name, value) == OK, instance.log
        if k == run["restore"]:
            other = Instance(fmu)
            data = instance.serialize(instance.save())
            assert other.restore(data) == OK, other.log
            instance = other
        assert instance.step(k * run["size"], run["size"]) == OK, instance.log
        rows.append({name: value.hex() if isinstance(value, float) else value
                     for name, value in instance.outputs().items()})
    print(json.dumps(rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
