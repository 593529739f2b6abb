"""The thesis figure by figure: every entry of its two lists, reproduced by simulation or marked with why not."""
