"""Linear and describing-function analysis of the actuator the FMU runs (extra `analysis`).

Each module computes one thing from the linear models of `bench.linear` and the compiled kernel. `analyse` runs them
all, `output` writes the result.
"""
