"""Linear and describing-function analysis of the model the FMU runs (extra `analysis`).

`wiring` composes the physics functions into a continuous-time plant, `linear` takes their exact
Jacobians and makes python-control systems of them; the other modules ask those, and the compiled
kernel, one question each. `analyse` asks them all.
"""
