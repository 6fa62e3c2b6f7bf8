"""Least squares: solvers, robust loss, covariances. Independent of the vehicle model."""
