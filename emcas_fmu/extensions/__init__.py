"""What may be laid over an actuator, in its name behind a +: a module each, with its EXTENSION."""
