"""Verbs of the laboratory: one file per verb, loaded when it is called."""
