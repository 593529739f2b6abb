"""Several fins as a system: an SSP 1.0 archive, written and checked.

`write` builds an archive from `variants` (each fin's parameters), `sets` (the SSV files) and a template (the SSD
files). `structure` and `interface` read archives of that form; `check` checks them.
"""
