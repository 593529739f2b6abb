"""Ways to run the actuator: traced Python source, and the schedule that drives it."""
