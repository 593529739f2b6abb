"""Plots of pages and files by Matplotlib, and their curves as data for the pages' script."""
