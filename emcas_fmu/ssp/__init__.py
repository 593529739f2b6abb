"""Four fins as a system: an SSP 1.0 archive written from the variable table, checked, and run in three hosts.

`write` makes the archive out of `variants` (what each fin's parameters are), `sets` (the SSV files) and `system`
(the SSD files). `structure` and `interface` read archives back, anybody's; `check` judges them; `hosts` runs them.
"""
