"""The operations that equations use, over floats, arrays, symbols and traced programs.

Equations are written once, as functions whose first argument `ops` is one of these namespaces:

- ``floats.FLOATS`` plain Python numbers (standard library only),
- ``arrays.ARRAYS`` NumPy arrays, element by element,
- ``symbols.SYMBOLS`` CasADi expressions,
- :class:`emcas_fmu.trace.tracer.Tracer` records the operations as a straight-line program.
"""
