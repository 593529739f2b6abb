"""An actuator whose controllers and plant are two FMUs, so that hardware can replace either."""
