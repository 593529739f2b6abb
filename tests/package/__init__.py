"""Tests of the distributed archives and of the package's layers."""
