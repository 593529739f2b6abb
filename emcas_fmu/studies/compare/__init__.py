"""Parameter sets side by side, by the requirements of the thesis's Table 2."""
