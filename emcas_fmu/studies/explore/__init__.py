"""A page in which the browser runs an actuator's generated C."""
