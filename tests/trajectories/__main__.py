"""Write the table of trajectories anew."""

from .table import write

write()
