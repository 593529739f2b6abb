"""Cylinder on the lever of the fin: fed by a servovalve, or by a pump on a servomotor."""
