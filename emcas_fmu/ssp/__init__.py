"""Several fins as a system: an SSP 1.0 archive, written and checked.

`write` builds an archive from an FMU, templates and each fin's parameters (`variants`). `structure` reads archives of
this form, `check` checks them.
"""
