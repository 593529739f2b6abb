"""Studies: each defines what to run, what to measure and what to write."""
