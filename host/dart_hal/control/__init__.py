"""Controllers and command sources: what a Car is told to do."""
