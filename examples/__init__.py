"""Examples of the actuator in other people's simulations."""
