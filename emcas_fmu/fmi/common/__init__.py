"""C code that all versions of FMI share: an instance, its life cycle, states and steps."""
