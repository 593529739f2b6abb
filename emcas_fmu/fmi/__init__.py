"""Everything FMI-shaped, generated from the variable table."""
