"""Bayesian modal identification of a few close modes from the Fourier lines of a narrow band."""
