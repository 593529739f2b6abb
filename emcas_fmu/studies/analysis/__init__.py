"""Linear and describing-function analysis of an actuator (extra `analysis`).

Each module computes one result from the linear models of `bench.linear` and the compiled kernel. `analyse` calls them
all; `report` writes the results.
"""
