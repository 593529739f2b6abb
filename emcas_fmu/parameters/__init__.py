"""Parameter sets, their files, the entries of a file, and checks of whole sets."""

from .checks import broken_rules, check_combinations, check_parameters, require_sound
from .entries import IDENTIFIED, Entry, ParameterError, Scalar, as_text, file_entry
from .measured import MeasuredRecord
from .sets import ParameterSet, are_defaults, load_parameters, parameter_file, shipped_file, write_parameters

__all__ = ["IDENTIFIED", "Entry", "MeasuredRecord", "ParameterError", "ParameterSet", "Scalar", "are_defaults",
           "as_text", "broken_rules", "check_combinations", "check_parameters", "file_entry", "load_parameters",
           "parameter_file", "require_sound", "shipped_file", "write_parameters"]
