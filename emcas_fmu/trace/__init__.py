"""Equations recorded as straight-line programs, and printers of these programs as Python and C."""
