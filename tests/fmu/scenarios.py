"""Sequences of calls that a host may make to the FMU: `python scenarios.py NAME FOLDER` runs one in its own process.

Standard library only. A scenario returns results for JSON; `test_fmu.py` judges them.
"""

from __future__ import annotations

import ctypes as ct
import json
import math
import pathlib
import resource
import struct
import sys
import threading
import zlib
from collections.abc import Callable
from typing import Any

from host import DISCARD, ERROR, OK, WARNING, Fmu, Instance  # type: ignore[import-not-found]

COMMAND = {"fin_command": 0.2, "aero_torque": -20.0}
WARM_UP = 0.02


def started(fmu: Fmu, **values: Any) -> Instance:
    """Return an instance after a run of `WARM_UP` [s], in which every call has succeeded."""
    instance = Instance(fmu)
    assert instance.initialize(**values) == [OK] * (3 + len(values)), instance.log
    assert instance.run(0.0, WARM_UP, 1e-3, **COMMAND) == OK, instance.log
    return instance


def plain_run(fmu: Fmu) -> Any:
    instance = started(fmu)
    status = instance.run(WARM_UP, 0.3, 1e-3)
    return {"status": status, "outputs": instance.outputs(), "log": instance.log,
            "modules": sorted({name.split(".")[0] for name in sys.modules})}


def hostile_step(fmu: Fmu) -> Any:
    """Bad steps and inputs are refused with a reason; then the run continues as if they had not occurred."""
    clean, instance = started(fmu), started(fmu)
    bystander = started(fmu)
    findings = {}

    def attempt(name: str, action: Callable[[], int]) -> None:
        instance.log.clear()
        before = instance.outputs()
        status = action()
        findings[name] = {"status": status, "log": instance.messages(DISCARD) + instance.messages(ERROR),
                          "unchanged": instance.outputs() == before}

    attempt("negative size", lambda: instance.step(WARM_UP, -1e-3))
    attempt("zero size", lambda: instance.step(WARM_UP, 0.0))
    attempt("nan size", lambda: instance.step(WARM_UP, math.nan))
    attempt("infinite size", lambda: instance.step(WARM_UP, math.inf))
    attempt("nan time", lambda: instance.step(math.nan, 1e-3))
    attempt("backwards", lambda: instance.step(WARM_UP - 5e-3, 1e-3))
    attempt("leap", lambda: instance.step(WARM_UP + 5e-3, 1e-3))
    for name in ("fin_command", "aero_torque", "acceleration.x", "attitude.pitch", "supply_voltage"):
        for bad in (math.nan, math.inf, -math.inf):
            good = instance.get(name)

            def bad_input(name: str = name, bad: float = bad, good: float = good) -> int:
                instance.set(name, bad)
                during = instance.outputs()
                status: int = instance.step(WARM_UP, 1e-3)
                assert instance.outputs() == during
                assert all(math.isfinite(x) for x in during.values())
                instance.set(name, good)
                return status

            attempt(f"{name} {bad}", bad_input)
    # With finite but absurd inputs the fin moves to its stop, or the step is refused; outputs remain finite.
    absurd = started(fmu)
    absurd.set("fin_command", 1e300)
    absurd.set("aero_torque", 1e300)
    absurd_status = absurd.step(WARM_UP, 1e-3)
    finite = all(math.isfinite(x) for x in absurd.outputs().values())
    for each in (clean, instance, bystander):
        each.run(WARM_UP, 0.1, 1e-3)
    return {"findings": findings, "same": clean.outputs() == instance.outputs() == bystander.outputs(),
            "absurd": [absurd_status, finite]}


def read_partly(fmu: Fmu, instance: Instance | None = None) -> Any:
    """Read a Real and, in the same call, a Boolean as a Real."""
    return (instance or started(fmu)).get_vr("Real", [fmu.references[name] for name in ("fin_angle", "enable")])


def misuse(fmu: Fmu) -> Any:
    """Each wrong call, e.g. a write to an output, is followed by two steps."""
    findings = {}
    actions: dict[str, Callable[[Instance], int]] = {
        "set unknown": lambda i: i.set_vr("Real", 100_000, 1.0),
        "set negative": lambda i: i.set_vr("Real", 2**32 - 1, 1.0),
        "set wrong type": lambda i: i.set_vr("Integer", fmu.references["fin_command"], 1),
        "set output": lambda i: i.set("fin_angle", 1.0),
        "set fixed": lambda i: i.set("motor.resistance", 1.0),
        "set partly": lambda i: i.set_reals([fmu.references["fin_command"], fmu.references["fin_angle"]], [-0.1, 1.0]),
        "get unknown": lambda i: i.get_vr("Real", [100_000])[0],
        "get wrong type": lambda i: i.get_vr("Boolean", [fmu.references["fin_angle"]])[0],
        "get Boolean as Real": lambda i: i.get_vr("Real", [fmu.references["enable"]])[0],
        "get partly": lambda i: read_partly(fmu, i)[0],
    }
    for name, action in actions.items():
        instance, clean = started(fmu), started(fmu)
        instance.log.clear()
        status = action(instance)
        log = instance.messages(ERROR)
        first = instance.step(WARM_UP, 1e-3)
        second = instance.step(WARM_UP + (1e-3 if first == OK else 0.0), 1e-3)
        clean.run(WARM_UP, WARM_UP + 1e-3 * (2 - bool(first)), 1e-3)
        findings[name] = {"status": status, "log": log, "first": first, "second": second,
                          "same": clean.outputs() == instance.outputs()}
    early, late = Instance(fmu), started(fmu)
    late.call("Terminate")
    early_status, late_status = early.step(0.0, 1e-3), late.step(WARM_UP, 1e-3)
    return {"findings": findings, "order": {"early": [early_status, early.messages(early_status)],
                                            "late": [late_status, late.messages(late_status)]}}


def refused_parameters(fmu: Fmu) -> Any:
    """Initialize with parameters out of range or without physical sense, then again after a reset."""
    cases: dict[str, dict[str, Any]] = {
        "negative": {"motor__resistance": -1.0},
        "nan": {"kinematics__moment_arm": math.nan},
        "infinite": {"drive__kp": math.inf},
        "stop inside command": {"fin__stop_angle": 0.1},
        "delay": {"drive__transport_delay": 0.1, "controller__sample_time": 5e-4},
        "multiplier": {"encoder__multiplier": 3},
        "lever": {"kinematics__initial_angle": 1.04, "fin__stop_angle": 0.6},
        "percent": {"friction__temperature": 1e9},
    }
    findings = {}
    for name, values in cases.items():
        instance = Instance(fmu)
        statuses = instance.initialize(**values)
        findings[name] = {"init": max(statuses), "log": instance.messages(ERROR),
                          "steps": [instance.step(0.0, 1e-3), instance.step(0.0, 1e-3)]}
        assert instance.call("Reset") == OK
        findings[name]["after reset"] = max(*instance.initialize(), instance.step(0.0, 1e-3))
        instance.free()
    tunable = started(fmu)
    status = tunable.set("controller.position.kp", -1.0) or tunable.step(WARM_UP, 1e-3)
    message = tunable.messages(status)
    tunable.set("controller.position.kp", 50.0)
    return {"findings": findings, "tunable": [status, tunable.step(WARM_UP, 1e-3), message]}


def tuned_against_a_rule(fmu: Fmu) -> Any:
    """Tune a parameter to a value within its limits that breaks a rule, alone and with other values; then mend it."""
    name, gain = "controller.antiwindup", "controller.position.kp"
    references = [fmu.references[n] for n in ("fin_command", gain, name)]
    actions: dict[str, Callable[[Instance], int]] = {
        "alone": lambda i: i.set(name, 1e4),
        "with others": lambda i: i.set_reals(references, [-0.3, 20.0, 1e4])}
    findings = {}
    for case, tune in actions.items():
        instance, clean = started(fmu), started(fmu)
        before = instance.get(name)
        statuses = [tune(instance), instance.step(WARM_UP, 1e-3)]
        log = instance.log.copy()
        restored = instance.restore(instance.serialize(instance.save()))
        for key, value in {"fin_command": 0.2, gain: clean.get(gain), name: before}.items():
            instance.set(key, value)
        statuses.append(instance.run(WARM_UP, 0.1, 1e-3))
        clean.run(WARM_UP, 0.1, 1e-3)
        findings[case] = {"statuses": statuses, "log": log, "restored": restored,
                          "same": instance.outputs() == clean.outputs()}
    return findings


def state(fmu: Fmu) -> Any:
    """Continue from a state after restoring it in its instance, in a running one and in a new one."""
    instance = started(fmu, friction__temperature=10.0)
    saved = instance.save()
    data = instance.serialize(saved)

    def continued(i: Instance) -> list[Any]:
        rows = [i.outputs()]
        i.set("controller.position.ki", 20.0)
        for k in range(100):
            i.set("fin_command", 0.2 if k < 50 else -0.3)
            assert i.step(WARM_UP + k * 0.7e-3, 0.7e-3) == OK, i.log
            rows.append(i.outputs())
        return rows

    uninterrupted = continued(instance)
    assert instance.call("SetFMUstate", saved) == OK
    restored = continued(instance)
    other, fresh = started(fmu), Instance(fmu)
    assert other.restore(data) == fresh.restore(data) == OK
    transplanted, into_fresh = continued(other), continued(fresh)
    middle = instance.save()
    tail = [instance.step(WARM_UP + 0.07, 0.33e-3), instance.outputs()]
    instance.call("SetFMUstate", middle)
    inside_tick = tail == [instance.step(WARM_UP + 0.07, 0.33e-3), instance.outputs()]
    return {"restored": restored == uninterrupted, "transplanted": transplanted == uninterrupted,
            "fresh": into_fresh == uninterrupted, "inside tick": inside_tick,
            "moved": uninterrupted[-1] != uninterrupted[0]}


def rolled_back(fmu: Fmu) -> Any:
    """After a wrong call, restore the state after every refused step, as a host that tries smaller steps."""
    instance, clean = started(fmu), started(fmu)
    instance.set("fin_angle", 1.0)
    saved, statuses = instance.save(), []
    for _ in range(3):
        statuses.append(instance.step(WARM_UP, 1e-3))
        if statuses[-1] == OK:
            break
        assert instance.call("SetFMUstate", saved) == OK
    clean.step(WARM_UP, 1e-3)
    return {"statuses": statuses, "same": instance.outputs() == clean.outputs()}


def corrupt_state(fmu: Fmu) -> Any:
    """Restore serialized states that are damaged or from another FMU, then run on."""
    instance, clean = started(fmu), started(fmu)
    data = instance.serialize(instance.save())
    damaged = [data[:i] + bytes([data[i] ^ 0x15]) + data[i + 1:] for i in range(0, len(data), 7)]
    damaged += [b"", b"x", data[:-1], data + b" ", b"\0" * 100, b"\0" * len(data), data.replace(b"-", b"_")]
    refused = 0
    for bytes_ in damaged:
        instance.log.clear()
        status = instance.restore(bytes_)
        if status == OK:  # the Python FMU can refuse only a step
            status = instance.step(WARM_UP, 1e-3)
        refused += "FMU state refused" in instance.messages(ERROR) and status in (DISCARD, ERROR)
    instance.run(WARM_UP, 0.1, 1e-3)
    clean.run(WARM_UP, 0.1, 1e-3)
    return {"damaged": len(damaged), "refused": refused, "same": instance.outputs() == clean.outputs()}


def _forged(data: bytes, start: float, gain: float) -> dict[str, bytes]:
    """Return serialized states with one impossible value and a correct checksum.

    The original has this start time, and a tunable parameter with the value `gain`.
    """
    states = {}
    if b" [" not in data[:80]:  # native: 64 bytes that identify the FMU, FNV-1a checksum, content
        for name, right, wrong in (("start", start, 1e19), ("gain", gain, -1.0)):  # the gain in use is its last
            content = struct.pack("<d", wrong).join(data[72:].rsplit(struct.pack("<d", right), 1))
            check = 14695981039346656037
            for byte in content:
                check = (check ^ byte) * 1099511628211 % 2**64
            states[name] = data[:64] + struct.pack("<Q", check) + content
        return states
    guid, _, body = data.split(b" ", 2)
    for name, indices, value in (("start", (0,), 1e19), ("text", (3,), "\ud800"), ("position", (7, 1), 1e300),
                                 ("period", (7, 0), -1), ("plant", (7, 2, 0), math.nan), ("values", (5, 0), "x"),
                                 ("gain", (6, json.loads(body)[6].index(gain)), -1.0)):
        forged = json.loads(body)
        forged[4] = True  # parameters may have been tuned
        entry = forged
        for index in indices[:-1]:
            entry = entry[index]
        entry[indices[-1]] = value
        text = json.dumps(forged).encode()
        states[name] = b"%s %08x %s" % (guid, zlib.crc32(text), text)
    return states


def forged_state(fmu: Fmu) -> Any:
    """Restore states with impossible values and a correct checksum, then run on."""
    start, findings = 1234.5, {}
    instance, clean = Instance(fmu), Instance(fmu)
    for each in (instance, clean):
        each.initialize(start)
        each.run(start, start + WARM_UP, 1e-3, **COMMAND)
    instance.set("controller.position.kp", 51.25)
    instance.get("fin_angle")  # the gain is in use
    clean.set("controller.position.kp", 51.25)
    for name, data in _forged(instance.serialize(instance.save()), start, 51.25).items():
        instance.log.clear()
        status = instance.restore(data)
        if status == OK:  # the Python FMU can refuse only a step
            status = instance.step(start + WARM_UP, 1e-3)
        findings[name] = [status, instance.messages(ERROR)]
    instance.run(start + WARM_UP, start + 0.1, 1e-3)
    clean.run(start + WARM_UP, start + 0.1, 1e-3)
    return {"findings": findings, "same": instance.outputs() == clean.outputs()}


def start_times(fmu: Fmu) -> Any:
    """Start at a system clock's time, and at times so large that a tick is below their floating-point resolution."""
    findings = {}
    for start in (1.7e9, 1e19, -2.3e20):
        instance = Instance(fmu)
        initialized = instance.initialize(start)[-1]
        findings[f"{start:g}"] = [initialized, instance.step(start, 1e-3), instance.messages(ERROR)]
    leaping = started(fmu)
    findings["leap"] = [OK, leaping.step(1e19, 1e-3), leaping.messages(ERROR)]
    findings["long"] = [OK, leaping.step(WARM_UP, 1e19), leaping.messages(DISCARD)]
    return findings


def stop_time(fmu: Fmu) -> Any:
    """Step to the stop time, past it by the rounding error of a sum of steps, and past it by a step."""
    findings, start, stop = {}, 1000.0, 1000.1
    for late in (0.0, 9e-7, 1e-3):
        instance = Instance(fmu)
        statuses = instance.initialize(start, stop)
        statuses += [instance.step(start, 0.09), instance.step(start + 0.09, stop - start - 0.09 + late)]
        findings[f"{late:g}"] = [max(statuses), instance.messages(statuses[-1]), instance.step(start + 0.09, 0.005)]
    restored = Instance(fmu)
    restored.restore(instance.serialize(instance.save()))
    findings["restored"] = [restored.step(start + 0.095, 0.1), restored.messages(ERROR) + restored.messages(DISCARD)]
    instance.call("Reset")
    findings["reset"] = [max(*instance.initialize(start), instance.step(start, 0.2)), ""]
    for name, wrong in (("before", start - 1.0), ("nan", math.nan)):
        refused = Instance(fmu)
        statuses = refused.initialize(start, wrong)
        findings[name] = [max(*statuses, refused.step(start, 1e-3)), refused.messages(ERROR)]
    return findings


def reset(fmu: Fmu) -> Any:
    """Run a cold actuator, reset it, and run it as a new one."""
    def outputs(instance: Instance, **values: Any) -> Any:
        instance.initialize(**values)
        instance.run(0.0, 0.1, 1e-3, **COMMAND)
        return instance.outputs()

    instance = Instance(fmu)
    cold = outputs(instance, friction__temperature=-6.0)
    instance.call("Reset")
    fresh = outputs(Instance(fmu))
    return {"same": outputs(instance) == fresh, "cold differs": cold != fresh}


def warned(fmu: Fmu) -> Any:
    """Log warnings while the temperature leaves, enters, leaves and stays outside the identified range."""
    instance = Instance(fmu)
    statuses = instance.initialize(friction__temperature=-40.0)
    warnings = [instance.messages(WARNING)]
    for time, temperature in enumerate((-6.0, 60.0, 70.0)):
        instance.log.clear()
        statuses.append(instance.set("friction.temperature", temperature))
        instance.get("fin_angle")  # reading an output before the step must not lose the warning
        statuses.append(instance.step(1e-3 * time, 1e-3))
        warnings.append(instance.messages(WARNING))
    return {"statuses": statuses, "warnings": warnings}


def unconnected(fmu: Fmu) -> Any:
    """Log warnings at the first command while unconnected inputs are 0."""
    findings = {}
    for name, values in (("both", {"supply_voltage": 0.0, "enable": False}), ("supply", {"supply_voltage": 0.0}),
                         ("enable", {"enable": False}), ("none", {})):
        instance = Instance(fmu)
        statuses = instance.initialize()
        statuses += [instance.set(key, value) for key, value in values.items()] + [instance.step(0.0, 1e-3)]
        before = instance.messages(WARNING)
        for k in range(1, 4):
            statuses += [instance.set("fin_command", 0.1 * k), instance.step(1e-3 * k, 1e-3)]
        findings[name] = [max(statuses), before, [text for status, text in instance.log if status == WARNING]]
    return findings


def slicing(fmu: Fmu) -> Any:
    """Return the differences of the fin angle between step sizes and start times, with inputs constant over 37 ms."""
    interval = 37e-3

    def angles(size: float, start: float, bias: float = 0.0) -> list[float]:
        instance = Instance(fmu)
        instance.initialize(start)
        angles, time = [], 0.0
        for k in range(1, 9):
            instance.set("fin_command", 0.25 * (-1) ** (k // 3))
            instance.set("aero_torque", -40.0 + 10.0 * k)
            while time < k * interval - 1e-6:
                end = time + size if time + size <= k * interval - 1e-6 else k * interval + bias
                assert instance.step(start + time, end - time) == OK, instance.log
                time = end
            angles.append(instance.get("fin_angle"))
        return angles

    reference = angles(interval, 0.0)
    grids = {f"{size} from {start}": angles(size, start)
             for size in (10e-3, 1e-3, 0.37e-3) for start in (0.0, 1234.5)}
    # After an hour a sum of steps is fractions of a microsecond early or late.
    grids |= {f"clock off by {bias}": angles(1e-3, 0.0, bias) for bias in (3e-7, -3e-7)}
    return {name: max(abs(a - b) for a, b in zip(grid, reference)) for name, grid in grids.items()}


def threads(fmu: Fmu) -> Any:
    """Step four instances one after the other, and four others at the same time in threads."""
    def run(instance: Instance, k: int) -> None:
        instance.run(WARM_UP, 0.2, 1e-3, fin_command=0.05 * (k + 1))

    sequential = [started(fmu) for _ in range(4)]
    for k, instance in enumerate(sequential):
        run(instance, k)
    parallel = [started(fmu) for _ in range(4)]
    workers = [threading.Thread(target=run, args=(i, k)) for k, i in enumerate(parallel)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return {"same": [i.outputs() for i in parallel] == [i.outputs() for i in sequential],
            "distinct": len({i.get("fin_angle") for i in sequential}) == 4}


def many(fmu: Fmu) -> Any:
    """Return the memory [KiB] of one of 200 instances, after creating and freeing 300 more."""
    def stepped() -> Instance:
        instance = Instance(fmu)
        instance.initialize()
        instance.run(0.0, 5e-3, 1e-3, **COMMAND)
        return instance

    def resident() -> float:
        pages = int(pathlib.Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
        return pages * resource.getpagesize() / 1024.0

    first = [stepped() for _ in range(20)]
    before = resident()
    more = [stepped() for _ in range(200)]
    each = (resident() - before) / len(more)
    ok = all(i.get("fin_angle") == first[0].get("fin_angle") for i in more)
    for instance in [*first, *more]:
        instance.free()
    for _ in range(300):
        stepped().free()
    return {"KiB each": each, "ok": ok, "alive": math.isfinite(stepped().get("fin_angle"))}


def dry_instance(fmu: Fmu) -> Any:
    """Return the outputs before, during and after initialization."""
    instance = Instance(fmu)
    before = instance.outputs()
    instance.setup()
    instance.enter()
    instance.set("fin.start_angle", 0.1)
    instance.set("fin_command", 0.3)
    during = instance.outputs()
    instance.call("ExitInitializationMode")
    return {"before": before, "during": during, "after": instance.outputs()}


def wrong_input_before_the_run(fmu: Fmu) -> Any:
    """Set an input to NaN during initialization, read before and after its end, then mend the input and step."""
    findings = {}
    for name in ("read", "not read"):
        instance, clean = Instance(fmu), Instance(fmu)
        for each in (instance, clean):
            each.setup()
            each.enter()
        instance.get("fin_angle")
        for each in (instance, clean):
            each.set("fin.start_angle", 0.1)
        instance.set("fin_command", math.nan)
        outputs = [instance.outputs()] if name == "read" else []
        statuses = [each.call("ExitInitializationMode") for each in (instance, clean)]
        outputs.append(instance.outputs())
        statuses.append(instance.step(0.0, 1e-3))
        for each in (instance, clean):
            statuses += [each.set("fin_command", 0.2), each.step(0.0, 1e-3)]
        findings[name] = {"statuses": statuses, "same": instance.outputs() == clean.outputs(), "without": all(
            math.isnan(values["fin_angle"]) and math.isnan(values["motor_current"]) for values in outputs)}
    return findings


def other_guid(fmu: Fmu) -> Any:
    """Instantiate with another FMU's GUID, without a name, and as another kind of instance."""
    instances = {"guid": Instance(fmu, guid="{00000000-0000-0000-0000-000000000000}"), "name": Instance(fmu, name=""),
                 "kind": Instance(fmu, kind=0)}
    return {name: [instance.component.value, instance.messages(ERROR)] for name, instance in instances.items()}


def interpolation(fmu: Fmu) -> Any:
    """Compare runs with input derivatives on coarse and fine steps with runs on constant inputs."""
    rates = {"fin_command": 2.0, "aero_torque": -300.0, "supply_voltage": -20.0, "acceleration.x": 40.0,
             "attitude.pitch": 1.5}

    def angles(size: float, ramped: bool) -> list[float]:
        instance = Instance(fmu)
        assert instance.initialize(loads__gravity=True) == [OK] * 4
        angles, steps = [], round(10e-3 / size)
        for k in range(10 * steps):
            time = k * size
            for name, rate in rates.items():
                value = rate * time if name != "supply_voltage" else 39.0 + rate * time
                assert instance.set(name, value) == OK
                if ramped:
                    assert instance.differentiate(name, 1, rate) == OK
            assert instance.step(time, size) == OK, instance.log
            if (k + 1) % steps == 0:
                angles.append(instance.get("fin_angle"))
        return angles

    coarse, fine, finest = angles(10e-3, True), angles(1e-3, True), angles(0.1e-3, False)
    constant = angles(10e-3, False)
    instance = started(fmu)
    bad = {"order 2": instance.differentiate("fin_command", 2, 1.0),
           "nan": instance.differentiate("fin_command", 1, math.nan),
           "output": instance.differentiate("fin_angle", 1, 1.0),
           "parameter": instance.differentiate("motor.resistance", 1, 1.0)}
    once = started(fmu)
    once.differentiate("fin_command", 1, 100.0)
    assert once.step(WARM_UP, 1e-3) == OK
    first = once.get("tracking_error") - (0.2 + 100.0 * 1e-3 - once.get("fin_angle"))
    assert once.step(WARM_UP + 1e-3, 1e-3) == OK
    second = once.get("tracking_error") - (0.3 - once.get("fin_angle"))  # constant after the end of the ramp
    second += once.get("fin_command") - 0.3
    third = started(fmu)
    third.differentiate("aero_torque", 1, 1000.0)
    assert third.step(WARM_UP, 10e-3) == OK
    before = third.outputs()
    other = started(fmu)
    assert other.restore(third.serialize(third.save())) == OK
    third.set("controller.position.kp", 70.0)
    restored = other.outputs() == before == third.outputs()
    return {"coarse-fine": max(abs(a - b) for a, b in zip(coarse, fine)),
            "coarse-finest": max(abs(a - b) for a, b in zip(coarse, finest)),
            "constant-finest": max(abs(a - b) for a, b in zip(constant, finest)),
            "bad": bad, "log": instance.messages(ERROR), "used once": [first, second], "restored": restored,
            "before init": Instance(fmu).differentiate("fin_command", 1, 1.0)}


def statuses(fmu: Fmu) -> Any:
    """Call the status functions after successful and refused steps."""
    instance = started(fmu)
    results: dict[str, Any] = {"last": instance.status("Real", 2), "terminated": instance.status("Boolean", 3)}
    instance.set("aero_torque", 1e300)
    results["absurd"] = instance.step(WARM_UP, 1e-3)
    results["after"] = [instance.status("Real", 2), instance.status("Boolean", 3)]
    instance.set("aero_torque", 0.0)
    results["huge step"] = instance.step(WARM_UP, 1e12)
    results["recovered"] = [instance.step(WARM_UP, 1e-3), instance.status("Boolean", 3)]
    results["unavailable"] = [instance.status("Integer", 0)[0], instance.status("Real", 3)[0],
                              instance.call("CancelStep")]
    return results


def logging(fmu: Fmu) -> Any:
    """Log an error and a discarded step with various categories switched on and off."""
    def count(logging: bool, calls: list[tuple[bool, list[str]]]) -> list[int]:
        instance = Instance(fmu, logging=logging)
        statuses = [instance.debug(*call) for call in calls]
        instance.initialize()
        instance.log.clear()
        instance.step(math.nan, 1e-3)
        instance.step(0.0, 1e12)
        return [max(statuses, default=OK), len(instance.messages(ERROR)) > 0, len(instance.messages(DISCARD)) > 0]

    every = ["logStatusError", "logStatusDiscard"]
    return {"off": count(False, []), "on": count(True, []), "switched on": count(False, [(True, [])]),
            "errors": count(False, [(True, ["logStatusError"])]), "less": count(True, [(False, ["logStatusError"])]),
            "all": count(False, [(True, ["logAll"])]), "switched off": count(True, [(False, [])]),
            "both": count(False, [(True, every)]), "unknown": count(False, [(True, ["logNonsense"])])}


def missing_arguments(fmu: Fmu) -> Any:
    """Pass null pointers for arrays, states and the instance."""
    instance = started(fmu)
    calls = {"no arrays": instance.read_without_arrays(3),
             "no values": instance.read_without_arrays(0),
             "no categories": instance.call("SetDebugLogging", ct.c_bool(True), ct.c_size_t(2), None),
             "no state": instance.call("SetFMUstate", None),
             "state to nowhere": instance.call("GetFMUstate", None),
             "strings": instance.call("GetString", (ct.c_uint * 1)(0), ct.c_size_t(1), (ct.c_char_p * 1)(),
                                      ct.c_size_t(1)),
             "free no state": instance.call("FreeFMUstate", None)}
    nobody = Instance(fmu, guid="none", logging=False)
    calls["no instance"] = min(nobody.call(name) for name in ("Reset", "Terminate", "ExitInitializationMode"))
    nobody.free()
    return {"calls": calls, "alive": instance.step(WARM_UP, 1e-3)}


if __name__ == "__main__":
    print(json.dumps(globals()[sys.argv[1]](Fmu(sys.argv[2]))))
