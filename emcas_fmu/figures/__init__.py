"""Figures of the pages and files: Matplotlib's, and the curves that a page draws from them."""
