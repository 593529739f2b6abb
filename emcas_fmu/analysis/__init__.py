"""Linear and describing-function analysis of the actuator the FMU runs (extra `analysis`).

`linear` takes exact Jacobians of what the actuator declares and makes python-control systems of them; the other
modules ask those, and the compiled kernel, one question each. `analyse` asks them all.
"""
