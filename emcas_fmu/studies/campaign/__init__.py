"""Campaigns: random samples or grids of parameters, commands, loads and faults, run on one machine or many."""
