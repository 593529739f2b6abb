"""Parameter sets: their files, the entries of a file, and checks of whole sets."""

from .entries import Entry, ParameterError, Value, as_text, file_entry
from .sets import (
    ParameterSet,
    are_defaults,
    broken_rules,
    check_combinations,
    check_parameters,
    load_parameters,
    parameter_file,
    require_sound,
    write_parameters,
)

__all__ = ["Entry", "ParameterError", "ParameterSet", "Value", "are_defaults", "as_text", "broken_rules",
           "check_combinations", "check_parameters", "file_entry", "load_parameters", "parameter_file",
           "require_sound", "write_parameters"]
