"""FMI 3.0 for co-simulation: arrays, clock and events, around the C code of fmi/common."""
