"""The actuator's physics: pure functions of (ops, parameters, ...), in SI units, temperatures in degC.

`p` is the parameter tree (:func:`emcas_fmu.namespace.namespace`), of numbers, arrays or symbols. Numbers in brackets
such as (2.5), and sections, are those of Yerlikaya (2016), "Dynamic modeling and control of an electromechanical
control actuation system", METU.
"""
