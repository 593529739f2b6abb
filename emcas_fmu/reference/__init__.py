"""Independent, event-located integrations of whole actuators, and the reference files made with them.

They are there to judge the package's fixed-tick stepping, so they use none of its equations: these are written
again in fin coordinates, integrated by SciPy with error control, and every change of mode (stick, slip, voltage limit,
mechanical stop) is located as a root instead of being stepped over.

Integrations: :mod:`.simulate` is the frame, over :mod:`.events` and :mod:`.actuator`, with :mod:`.vehicle`,
:mod:`.drive` and :mod:`.controllers`; each actuator is a class in a module of its name (:mod:`.plant` is the thesis's,
with :mod:`.screw`; :mod:`.coil` and :mod:`.piston` are shared). Files: :mod:`.cases` holds the excitations,
:mod:`.files` and :mod:`.stored` write and read responses, :mod:`.responses` caches them.

Sources: Ü. Yerlikaya's thesis (2016), equations 2.1 - 2.47 and section 4.2, cited by number where used.
"""
