"""Room of the fits: sub-models of ``vehicle`` identified from recordings."""
