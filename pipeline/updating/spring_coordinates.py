"""Coordinates in which foundations of one farm can be averaged: logarithms, and no edge.

A mean of two stiffness matrices' entries is a foundation, but a Gaussian in the entries, or in
their logarithms, has draws with k12² > k11·k22 that no pile can have. Here every point of space is
a positive definite foundation.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.updating.forward_model import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class SpringCoordinates:
    """x = (ln k11/k11⁰, ln k22/k22⁰, atanh ρ − atanh ρ⁰),   ρ = k12 / √(k11 k22)

    with ⁰ the nominal foundation, at which x = 0. The third is Fisher's z of the coupling, which
    fills the line while |ρ| < 1. About the IEA 15 MW monopile (ρ⁰ = .755) one percent of k12 alone
    moves it by .018.

    Source: Fisher (1921), Metron 1, for z; k as in [foundation-updating] Eq. 12.
    """

    nominal: FloatArray  # (3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad]; none 0, positive definite

    @property
    def _nominal_coupling(self) -> float:
        """ρ⁰ [-]"""
        return float(self.nominal[2] / np.sqrt(self.nominal[0] * self.nominal[1]))

    def of_ratios(self, ratios: FloatArray) -> FloatArray:
        """(..., 3) coordinates [-] of (..., 3) ratios k / nominal [-], positive definite ones."""
        coupling = self._nominal_coupling
        rho = coupling * ratios[..., 2] / np.sqrt(ratios[..., 0] * ratios[..., 1])
        z = np.arctanh(rho) - np.arctanh(coupling)
        return np.stack([np.log(ratios[..., 0]), np.log(ratios[..., 1]), z], axis=-1)

    def to_ratios(self, points: FloatArray) -> FloatArray:
        """(..., 3) ratios k / nominal [-] of (..., 3) coordinates [-]."""
        coupling = self._nominal_coupling
        rho = np.tanh(points[..., 2] + np.arctanh(coupling))
        r11, r22 = np.exp(points[..., 0]), np.exp(points[..., 1])
        return np.stack([r11, r22, rho / coupling * np.sqrt(r11 * r22)], axis=-1)

    def log_jacobian(self, points: FloatArray) -> FloatArray:
        """(...,) log |∂r/∂x|: up to a constant, the density in x of a prior uniform in k.

        |∂r/∂x| = (r11 r22)^(3/2) (1 − ρ²) / |ρ⁰|
        """
        coupling = self._nominal_coupling
        z = points[..., 2] + np.arctanh(coupling)
        log_softness = np.log(4.0) - 2 * np.logaddexp(z, -z)  # log(1 − tanh² z), exact far out
        return 1.5 * (points[..., 0] + points[..., 1]) + log_softness - np.log(abs(coupling))
