"""Expected output of the host in C for the native FMU, for its arguments `misuse` and `states`."""

from __future__ import annotations

OK, ERROR = 0, 3

# No instance is created, and the reason is logged: the numbers are 1 for an instance, and the number of messages.
_NO_INSTANCE = ("no name", "empty name", "no guid", "empty guid", "wrong guid", "model exchange")
_ERRORS = (
    "null doStep", "null setup", "null enter", "null leave", "null terminate", "null reset", "null get", "null set",
    "null save", "null logging", "null status", "no references", "no values", "save to nowhere", "no state to set",
    "no state to size", "no bytes",
    "step, instantiated", "step, initializing", "step, terminated", "leave, instantiated", "leave, stepping",
    "enter, initializing", "enter, stepping", "setup, stepping", "terminate, instantiated", "terminate, terminated",
    "cancel",
    "get unknown", "get last", "get wrong type", "get string", "set unknown", "set wrong type", "set output",
    "set fixed", "set input, terminated", "slope of an output", "slope of order 0", "slope of order 9",
    "slope unknown", "bad parameter", "nan parameter",
    "nan command", "infinite torque", "nan attitude", "nan supply", "step back", "step of nothing", "step of nan",
    "step without end", "step from nan", "step from the past", "step from the future",
)
_LEGAL = (
    "nothing to get", "nothing to set", "free no state", "no categories", "reset, instantiated", "reset, initializing",
    "reset, stepping", "reset, terminated", "get output, terminated", "set tunable", "slope", "huge command",
)

MISUSE: dict[str, str] = {
    "types": "default", "version": "2.0",
    **dict.fromkeys(_NO_INSTANCE, "0 1"),
    "no callbacks": "0 0",  # there is no logger
    "no resources": "1 0",
    **dict.fromkeys(_ERRORS, f"{ERROR} 1"),
    **dict.fromkeys(_LEGAL, f"{OK} 0"),
}

_ONLY_FMI2 = ("types", "null setup", "null status", "setup, stepping", "cancel")
MISUSE3: dict[str, str] = {
    **{name: numbers for name, numbers in MISUSE.items() if name not in _ONLY_FMI2 and not name.startswith("slope")},
    "version": "3.0",
    "no callbacks": "1 0",  # the logger is optional
}

# All comparisons of `states` are true; wrong sizes and bytes give fmi2Error.
STATES: dict[str, str] = {
    **dict.fromkeys(("moved", "restored", "within", "moved over", "into fresh", "overwritten"), "1"),
    "free null": str(OK), "silent": "0", **dict.fromkeys(("cut", "empty", "no room"), str(ERROR)),
}
