"""What several verbs share: options, output, opening a car, pictures."""
