"""What is done on the bench: each study says what to run, what to measure and what to write."""
