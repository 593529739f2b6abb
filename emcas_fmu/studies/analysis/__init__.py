"""Linear and describing-function analysis of the actuator the FMU runs (extra `analysis`).

`smooth` takes exact Jacobians of what the actuator declares, once for all gains; `plant` and `linear` make
python-control systems of them, which `systems` connects and samples; the other modules compute one thing each from
those and the compiled kernel. `analyse` runs them all, `output` writes the result.
"""
