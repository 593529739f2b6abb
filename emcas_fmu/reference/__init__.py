"""Independent, event-located integrations of whole actuators, and the reference files made with them.

The integrations judge the package's fixed-tick stepping, and use none of its equations: these are written again and
integrated by SciPy with error control. Changes of mode (stick, slip, voltage limit, mechanical stop) are located as
roots.

Integrations: :class:`.ReferenceActuator` has the entry `simulate`; it uses :mod:`.events`, :mod:`.vehicle`,
:mod:`.drive`, :mod:`.controllers`, :mod:`.filters` and :mod:`.trajectory`. Each actuator is in the module of its name,
the thesis's actuator in :mod:`.plant` with :mod:`.screw`. Hydraulic actuators share :mod:`.piston`, those with clutches
:mod:`.coil`. :mod:`.linear` is the thesis's linear model.

Files: :mod:`.cases` contains the excitations; :mod:`.files` and :mod:`.stored` write and read responses;
:mod:`.responses` caches them.

Sources: Ü. Yerlikaya's thesis (2016), equations 2.1 - 2.47 and section 4.2, cited by number.
"""
