"""The commands of `emcas`, a file each: a function with its options, and its EPILOG of examples."""
