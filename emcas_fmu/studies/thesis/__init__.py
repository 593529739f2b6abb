"""The thesis figure by figure: every entry of its two lists, with what it meets, own values, or why it is not shown."""
