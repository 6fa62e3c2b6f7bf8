"""Room of the unexplained: what depends on the drive and has no name in the catalogue."""
