"""Steppers of plants: each computes one step, to the end of a tick or to the first event in it."""
