"""Controllers and command sources on top of the Car."""
