"""Electromechanical actuators: that of the thesis, others from the literature, worm gears, clutches and a servo."""
