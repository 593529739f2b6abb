"""Actuators linearised at an operating point, with exact sampling and delay (extra `analysis`).

`smooth` computes exact Jacobians of an actuator's equations, once for all gains; `plant` and `actuator` build
python-control systems from them, which `systems` connects and samples; `frequency` has responses and margins.
"""
