"""The validation of a model: trajectories against an independent reference, performance against Table 2."""
