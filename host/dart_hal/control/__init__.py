"""Controllers and command sources: what a Car is commanded."""
