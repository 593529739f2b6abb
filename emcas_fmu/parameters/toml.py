"""The standard library's TOML reader, or its backport for Python 3.10, under one name."""

import sys

if sys.version_info >= (3, 11):
    import tomllib as tomllib
else:
    import tomli as tomllib

__all__ = ["tomllib"]
