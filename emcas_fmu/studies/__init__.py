"""Studies: each defines its runs, its figures and the files that it writes."""
