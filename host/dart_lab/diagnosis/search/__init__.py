"""Room of the search: which effect of the catalogue explains the residuals, and how surely."""
