"""This process among others: forked children, locks that end with a process, work on all cores."""
