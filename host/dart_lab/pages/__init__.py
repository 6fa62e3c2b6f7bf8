"""Pages and tables of what verbs of the laboratory answer."""
