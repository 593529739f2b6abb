"""Equations recorded as straight-line programs, and the printers of these as Python and C."""
