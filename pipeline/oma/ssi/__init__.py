"""Covariance-driven stochastic subspace identification with uncertainty, band by band."""
