"""The validation of a model: trajectories against a reference, performance against requirements."""
