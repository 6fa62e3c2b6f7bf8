"""Processes: forked children, locks that end with a process, computations on all cores."""
