"""The commands of `emcas`, one file each in the form that `group.PANELS` describes, and the code that they share."""
