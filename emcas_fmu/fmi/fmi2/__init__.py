"""FMI 2.0 for co-simulation: the C of the native FMU and the slave of the Python one."""
