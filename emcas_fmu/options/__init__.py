"""What may be laid over a model of :mod:`emcas_fmu.actuators`, in its name behind a +.

An option is a module with

- TITLE, a phrase, and PARAMETERS, its own, whose default values are in ``models/options/OPTION.toml``;
- unfit(model, options), which says why it cannot be laid over a model or beside other options, nothing if it can;
- extended(model), the :class:`emcas_fmu.actuators.model.Model` that it makes of another.

Its own states, inputs and outputs stand behind those there are. A name in ``OPTIONS`` of
:mod:`emcas_fmu.actuators` is all there is to add besides.
"""
