"""What is given to others: the wheel and the source archive."""
