"""Run an unpacked FMU in a separate process: `python -m tests.extensions.drive FOLDER SCRIPT` prints its outputs.

SCRIPT is JSON: {"start": {name: value}, "size": s, "steps": n, "set": [[step, name, value], ...], "keep": step}. What
is kept at the step is put back into another instance, which goes on.
"""

from __future__ import annotations

import json
import sys

from tests.fmu.host import OK, Fmu, Instance


def main(folder: str, script: str) -> None:
    told = json.loads(script)
    fmu = Fmu(folder)
    instance = Instance(fmu)
    assert max(instance.initialize(**told["start"])) == OK, instance.log
    rows = []
    for k in range(told["steps"]):
        for step, name, value in told["set"]:
            if step == k:
                assert instance.set(name, value) == OK, instance.log
        if k == told["keep"]:
            other = Instance(fmu)
            data = instance.serialize(instance.save())
            assert other.restore(data) == OK, other.log
            instance = other
        assert instance.step(k * told["size"], told["size"]) == OK, instance.log
        rows.append({name: value.hex() if isinstance(value, float) else value
                     for name, value in instance.outputs().items()})
    print(json.dumps(rows))


if __name__ == "__main__":
    main(*sys.argv[1:])
