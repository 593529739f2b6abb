"""FMUs, generated from the declaration of an actuator."""
