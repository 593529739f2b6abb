"""Parameters from bench measurements, chapter 3 of Yerlikaya (2016): friction, drive, backlash, inertia."""
