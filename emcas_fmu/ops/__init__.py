"""The few operations physics needs, over floats, arrays, symbols and source code.

Physics is written once, as functions whose first argument is one of these
namespaces:

- :data:`FLOATS` plain Python numbers (standard library only),
- ``arrays.ARRAYS`` NumPy arrays, element by element,
- ``symbols.SYMBOLS`` CasADi expressions,
- :class:`trace.Tracer` records the operations as straight-line Python source.
"""

from .base import Ops
from .floats import FLOATS

__all__ = ["FLOATS", "Ops"]
