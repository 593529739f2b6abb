"""Functions for every part of the package that do not concern actuators: files, progress, arguments, extras."""
