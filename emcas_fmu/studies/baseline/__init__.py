"""Baselines: approved responses that are recorded once, reviewed as text, and compared after every change."""
