"""The EMPS drive: a ball-screw axis, calibrated on one of its records and compared with both."""
