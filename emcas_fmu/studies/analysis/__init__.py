"""Linear and describing-function analysis of an actuator (extra `analysis`).

Most modules compute one result each, from the linear models of `bench.linear` and simulations with the compiled kernel.
`analyse` calls them, except `envelope`; `report` writes the results.
"""
