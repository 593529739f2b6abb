"""Actuators linearised at an operating point, with exact sampling and delay (extra `analysis`).

`equations` defines plant and controllers as functions, and `smooth` traces their exact Jacobians as functions of the
gains. `plant` and `actuator` build python-control systems from them, which `systems` connects and samples; `frequency`
has responses and margins.
"""
