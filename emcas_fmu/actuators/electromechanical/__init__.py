"""Electromechanical actuators: the thesis's, others of the literature, and those with worm gear, clutch or servo."""
