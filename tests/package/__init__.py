"""What is distributed: the wheel and the source archive."""
