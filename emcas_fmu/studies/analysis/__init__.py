"""Linear and describing-function analysis of an actuator (extra `analysis`)."""
