"""The thesis, figure by figure: a program of the documentation, `python -m docs.thesis`."""
