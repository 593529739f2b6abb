"""Stepping any traced actuator in Python and in C: one fin, or several fins on a supply line."""
