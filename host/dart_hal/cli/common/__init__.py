"""Code shared by several verbs: options, output, opening a car, pictures."""
