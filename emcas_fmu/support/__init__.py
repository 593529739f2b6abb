"""Functions for every part of the package, not about actuators: files, progress, arguments, optional packages."""
