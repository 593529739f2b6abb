"""The page of an actuator whose generated C runs in the browser."""
