"""The sampled controllers and what they measure."""
