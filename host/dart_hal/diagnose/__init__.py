"""Room of the diagnosis: residuals, named causes, extended models."""
