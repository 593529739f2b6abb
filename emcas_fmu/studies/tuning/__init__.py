"""Tune the gains of any actuator, with its full equations, until they meet requirements in all cases."""
