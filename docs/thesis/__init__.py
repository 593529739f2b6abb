"""A program of the documentation, `python -m docs.thesis`: the thesis, figure by figure."""
