"""Displacement and rotation of the pile head under a load at the tower's top.

The springs at the mudline carry the lateral force H and the moment H·h of a load at the height h:

    [ k11 ±k12] [u]   [ H ]
    [±k12  k22] [ψ] = [H·h]

u, displacement along the load [m], ψ = dv/dz, rotation [rad]; + is the sign as published, by which
the mudline moves against a load from high above, − an embedded pile's. The tower's own bending is
left out, so that the picture shows the foundation alone. Picture units, y down, the mudline at 0.
No rerun here.
"""

from dataclasses import dataclass

import numpy as np

from pipeline.messages import FoundationPosterior, FoundationTruth
from pipeline.state.posterior_json import STIFFNESSES
from pipeline.viewer.pictures.corner import Text
from sensors.arrays import FloatArray
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import SpringSign, spring_matrix

LOAD = 1e6  # H [N]
TALL = 2.0  # the tower and what stands in the water [picture units]
LEAN = 0.5  # displacement of the top on the nominal foundation [picture units]
WALL = -0.7  # where the lateral spring is held [picture units]
STUB = 0.55  # of the pile below the mudline [picture units]
SINGULAR = 1e-12  # a determinant that is less, relative to k11·k22, is rounding
COILS = 6  # of the lateral spring
QUANTILES = (0.05, 0.5, 0.95)


@dataclass(frozen=True, slots=True, eq=False)
class PilePicture:
    """Everything to draw, in picture units."""

    fixed: tuple[FloatArray, ...]
    """Ground, unloaded axis, load; picture units."""
    springs: tuple[FloatArray, ...]
    """Lateral and rotational."""
    nominal: FloatArray
    """(2, 2) axis of the tower on the nominal foundation."""
    posterior: tuple[FloatArray, ...]
    """(2, 2) at 5, 50 and 95 % of displacement and rotation; empty if no draw carries a load."""
    truth: tuple[FloatArray, ...]
    """(2, 2); empty where it is not known."""
    texts: tuple[Text, ...]


def mudline_response(theta: FloatArray, height: float, sign: SpringSign) -> FloatArray:
    """Return u [m] and ψ [rad] at the mudline under LOAD at the tower's top, shape (..., 2).

    NaN for springs that carry no load: k11·k22 = k12², to rounding, or less.

    Parameters
    ----------
    theta : ndarray, shape (..., 3)
        k11 [N/m], k22 [N·m/rad], k12 [N/rad].
    height : float
        Height h of the top above the mudline [m].
    """
    springs = spring_matrix(theta, sign)
    k11, k22, coupling = springs[..., 0, 0], springs[..., 1, 1], springs[..., 0, 1]
    determinant = k11 * k22 - coupling**2
    carries = determinant > SINGULAR * np.abs(k11 * k22)
    force_and_moment = np.stack([k22 - coupling * height, k11 * height - coupling], axis=-1)
    compliance = np.where(carries, LOAD / np.where(carries, determinant, 1.0), np.nan)
    return np.asarray(compliance[..., None] * force_and_moment)


def pile_picture(
    posterior: FoundationPosterior,
    description: TurbineDescription,
    truth: FoundationTruth | None = None,
) -> PilePicture:
    """Draw the tower under LOAD on its foundation, displacements much exaggerated."""
    height = description.tower_top - description.mudline

    def response(theta: FloatArray) -> FloatArray:
        return mudline_response(theta, height, description.foundation.sign)

    nominal = response(np.array([posterior.parameter(name).nominal for name in STIFFNESSES]))
    scale = LEAN / abs(_at_top(nominal, height))  # picture units a metre
    responses = _known(response(posterior.draws[:, :3]))
    quantiles = np.quantile(responses, QUANTILES, axis=0) if len(responses) else ()
    of_truth = np.empty((0, 3)) if truth is None else [[truth.k11, truth.k22, truth.k12]]
    true = _known(response(np.asarray(of_truth, dtype=np.float64)))
    return PilePicture(
        fixed=_fixed(),
        springs=(_coil(), _spiral()),
        nominal=_axis(nominal, height, scale),
        posterior=tuple(_axis(each, height, scale) for each in quantiles),
        truth=tuple(_axis(each, height, scale) for each in true),
        texts=_spring_texts(posterior) + _response_texts(responses, height, scale * height / TALL),
    )


def _known(responses: FloatArray) -> FloatArray:
    """Return the responses of springs that carry a load."""
    return responses[np.isfinite(responses).all(axis=1)]


def _at_top(response: FloatArray, height: float) -> float:
    """Displacement of the top [m]."""
    u, psi = response
    return float(u + height * psi)


def _axis(response: FloatArray, height: float, scale: float) -> FloatArray:
    """Return the axis from the mudline to the top."""
    return np.array([[scale * response[0], 0.0], [scale * _at_top(response, height), -TALL]])


def _fixed() -> tuple[FloatArray, ...]:
    ground = np.array([[-1.2, 0.0], [1.2, 0.0]])
    stub = np.array([[-0.08, 0.0], [-0.08, STUB], [0.08, STUB], [0.08, 0.0]])
    wall = np.array([[WALL, 0.02], [WALL, 0.22]])
    unloaded = np.array([[0.0, 0.0], [0.0, -TALL]])
    load = np.array([[-0.45, 0.0], [-0.05, 0.0], [-0.12, -0.04], [-0.05, 0.0], [-0.12, 0.04]])
    return ground, stub, wall, unloaded, load - [0.0, TALL]


def _coil() -> FloatArray:
    """Return the lateral spring, from the wall to the pile."""
    x = np.linspace(WALL + 0.1, -0.18, 2 * COILS)
    y = np.where(np.arange(2 * COILS) % 2 == 0, 0.06, 0.18)
    middle = 0.12
    return np.array([[WALL, middle], *np.stack([x, y], axis=1), [-0.08, middle]])


def _spiral() -> FloatArray:
    """Return the rotational spring, round the pile's head."""
    angle = np.linspace(0.0, 4 * np.pi, 80)
    radius = 0.04 + 0.16 * angle / angle[-1]
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def _spring_texts(posterior: FoundationPosterior) -> tuple[Text, ...]:
    places = ((-0.75, 0.32), (0.74, 0.14), (0.74, 0.32))
    texts = []
    for name, place in zip(STIFFNESSES, places, strict=True):
        k = posterior.parameter(name)
        texts.append(Text(place, f"{name} {k.median:.4g} {k.unit}, {k.median / k.nominal:.3f} ×"))
    return (*texts, Text((-0.95, -0.13), "mudline"))


def _response_texts(responses: FloatArray, height: float, exaggeration: float) -> tuple[Text, ...]:
    if not len(responses):
        return (Text((0.0, 0.72), "no draw of the posterior carries a load"),)
    u, psi = responses.T
    texts = (
        f"mudline displacement {_spread(1e3 * u)} mm",
        f"mudline rotation {_spread(1e3 * psi)} mrad",
        f"top by this alone {_spread(1e3 * (u + height * psi))} mm",
        f"median (5 to 95 %), drawn × {_round_to_two_digits(exaggeration):,.0f}",
    )
    lines = [Text((0.0, 0.72 + 0.13 * row), text) for row, text in enumerate(texts)]
    return (Text((-0.6, -TALL - 0.1), f"{LOAD / 1e6:g} MN"), *lines)


def _spread(values: FloatArray) -> str:
    low, middle, high = np.quantile(values, QUANTILES)
    return f"{middle:.4g} ({low:.4g} to {high:.4g})"


def _round_to_two_digits(number: float) -> float:
    """Round to two digits."""
    return float(f"{number:.1e}")
