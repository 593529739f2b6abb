"""Gains that meet requirements in every case at once, on the full equations of any actuator."""
