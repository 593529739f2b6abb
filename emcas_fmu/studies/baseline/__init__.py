"""A baseline, an approved response: recorded once, reviewed as text, compared at every change."""
