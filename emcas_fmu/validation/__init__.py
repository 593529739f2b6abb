"""Judging an FMU: runs against the stored references, performance figures, the thesis's requirements."""
