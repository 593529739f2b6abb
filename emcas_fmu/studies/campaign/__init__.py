"""Monte Carlo and grids over parameters, commands, loads and faults, on one machine or many."""
