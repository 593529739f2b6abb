"""Search for gains with which an actuator, simulated with its full equations, meets requirements in all cases."""
