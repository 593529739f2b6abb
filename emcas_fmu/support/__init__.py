"""What every part of the package uses and is not about actuators: files, progress, arguments, optional packages."""
