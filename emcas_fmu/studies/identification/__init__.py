"""Identify parameters from bench measurements (Yerlikaya 2016, chapter 3), and calibrate any actuator to records."""
