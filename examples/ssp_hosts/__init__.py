"""An SSP archive stepped in a loop by fmpy, libcosim or Ecos, under one interface."""
