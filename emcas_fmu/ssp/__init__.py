"""Four fins as a system: an SSP 1.0 archive written from the actuator's declaration, and checked.

`write` makes the archive out of `variants` (what each fin's parameters are), `sets` (the SSV files) and a template
(the SSD files). `structure` and `interface` read archives back, anybody's; `check` judges them.
"""
