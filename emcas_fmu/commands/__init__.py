"""The commands of `emcas`, one file each: a function whose arguments are the options, and an EPILOG of examples."""
