"""Four actuators on the joints of a body in MuJoCo."""
