"""This process among others: what a forked child lets go of, and locks that end with a process."""
