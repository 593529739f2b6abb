"""A simulated test bench: records with known answers for `emcas identify`."""
