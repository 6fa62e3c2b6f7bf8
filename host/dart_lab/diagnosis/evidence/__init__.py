"""Room of the evidence: recordings as residuals, and how much each residual counts."""
