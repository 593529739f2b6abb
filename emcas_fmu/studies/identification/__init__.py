"""From bench measurements to parameters, chapter 3 of Yerlikaya (2016): friction, drive, backlash, inertia."""
