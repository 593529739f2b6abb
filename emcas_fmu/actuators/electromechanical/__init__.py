"""Motor, drive, ball screw, lever and fin: the thesis's actuator and models of the literature put together from it."""
