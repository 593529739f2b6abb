"""Write the table of trajectories."""

from .table import write

write()
