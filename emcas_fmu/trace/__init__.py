"""Equations written down as straight-line programs, and their printing as Python and C."""
