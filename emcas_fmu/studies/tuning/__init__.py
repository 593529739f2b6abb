"""Search for gains with which any actuator, simulated with its full equations, meets requirements in all cases."""
