"""The sampled controllers and their sensors."""
