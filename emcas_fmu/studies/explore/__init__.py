"""An actuator in a page of its own: its generated C, run by the browser."""
