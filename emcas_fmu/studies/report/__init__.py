"""The acceptance test of an actuator: a file for each test, and the report that is signed."""
