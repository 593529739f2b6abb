"""An independent, event-located simulation of the whole actuator, and the reference files made with it.

It exists to judge the product's own fixed-tick stepping, so it takes nothing from it: the equations are
written again in fin coordinates, integrated by SciPy with error control, and every change of mode (stick,
slip, voltage limit, mechanical stop) is found as a root instead of being stepped over.

Sources: S. Yerlikaya's thesis (2016), equations 2.1 - 2.47 and section 4.2, cited by number where used.
"""
