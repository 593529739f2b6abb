"""Everything FMI-shaped, generated from what an actuator declares."""
