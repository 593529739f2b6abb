"""Actuators linearised at an operating point, with exact sampling and delay (extra `analysis`).

`smooth` takes exact Jacobians of what an actuator declares, once for all gains; `plant` and `actuator` make
python-control systems of them, which `systems` connects and samples; `frequency` has responses and margins.
"""
