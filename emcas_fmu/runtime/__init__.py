"""Stepping any traced actuator: in Python, in C, one or several fins on a line."""
