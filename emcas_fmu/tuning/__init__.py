"""Gains that meet requirements on the nonlinear model, in every case at once."""
