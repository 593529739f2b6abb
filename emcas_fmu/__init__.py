"""Nonlinear electromechanical control actuation system as an FMI 2.0 co-simulation unit."""

__version__ = "0.1.0"
