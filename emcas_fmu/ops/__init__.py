"""The operations that equations use, over floats, arrays, symbols and traced programs.

Equations are written once, as functions whose first argument `ops` is one of these namespaces:

- ``floats.FLOATS`` plain Python numbers (standard library only),
- ``located.LocatedFloats`` numbers that store the line of the user's file in which they became infinite or NaN,
- ``arrays.ARRAYS`` NumPy arrays, element by element,
- ``symbols.SYMBOLS`` CasADi expressions,
- :class:`emcas_fmu.trace.tracer.Tracer` records the operations as a straight-line program.
"""
