"""FMI 2.0 for co-simulation: the C code of the native FMU and the slave of the Python FMU."""
