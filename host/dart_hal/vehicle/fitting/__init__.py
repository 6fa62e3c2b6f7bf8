"""Least squares: solvers, robust loss, covariances. Knows nothing of cars."""
