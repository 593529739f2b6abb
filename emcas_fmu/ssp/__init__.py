"""Several fins as a system: an SSP 1.0 archive, written and checked.

`write` builds an archive from `variants` (each fin's parameters), an FMU and templates. `structure` reads archives of
that form, `check` checks them.
"""
