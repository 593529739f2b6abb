"""Linear and describing-function analysis of the actuator the FMU runs (extra `analysis`).

`linear` takes exact Jacobians of what the actuator declares and makes python-control systems of them; the other
modules compute one thing each from those and the compiled kernel. `analyse` runs them all, `output` writes the result.
"""
