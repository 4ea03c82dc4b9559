"""Who is pooled: the latest posterior of each turbine, unless something speaks against it."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.farm.evidence import FEWEST_DRAWS
from pipeline.messages import FoundationPosterior
from pipeline.updating.prior import PARAMETER_NAMES
from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True)
class LeftOut:
    """A turbine whose posterior could not be pooled."""

    turbine: str
    reason: str


def members_of(
    posteriors: Sequence[FoundationPosterior],
) -> tuple[list[FoundationPosterior], tuple[LeftOut, ...]]:
    """The latest posterior of each turbine that can be pooled, and why others cannot."""
    latest: dict[str, FoundationPosterior] = {}
    for each in sorted(posteriors, key=lambda posterior: posterior.time_ns):
        latest[each.turbine] = each
    ordered = [latest[name] for name in sorted(latest, key=in_order)]
    nominals = Counter(tuple(nominal_of(each).tolist()) for each in ordered)
    common = np.array(max(nominals, key=lambda nominal: nominals[nominal])) if nominals else None
    members, left_out = [], []
    for each in ordered:
        reason = _reason_against(each, common)
        if reason:
            left_out.append(LeftOut(each.turbine, reason))
        else:
            members.append(each)
    return members, tuple(left_out)


def _reason_against(posterior: FoundationPosterior, nominal: FloatArray | None) -> str:
    """Why a posterior cannot be pooled; "" where it can."""
    if not posterior.trusted:
        return "its posterior is not trusted"
    if posterior.population:
        return f"its posterior began with a population's prior ({posterior.population})"
    if nominal is None or not np.allclose(nominal_of(posterior), nominal, rtol=1e-6, atol=0.0):
        return "its nominal foundation is another one than the other turbines'"
    if len(posterior.draws) < FEWEST_DRAWS:
        return f"its posterior has {len(posterior.draws)} draws; {FEWEST_DRAWS} are needed"
    k11, k22, k12 = posterior.draws[:, :3].T
    possible = np.isfinite(posterior.draws).all() and np.all((k11 > 0) & (k11 * k22 > k12**2))
    return "" if possible else "its posterior has springs that no foundation has"


def nominal_of(posterior: FoundationPosterior) -> FloatArray:
    """(3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad] that a posterior's ratios are of."""
    return np.array([posterior.parameter(name).nominal for name in PARAMETER_NAMES])


def in_order(name: str) -> tuple[tuple[int, str], ...]:
    """A key by which turbine 2 comes before turbine 10."""
    parts = re.split(r"(\d+)", name)
    return tuple((int(part), "") if part.isdigit() else (-1, part) for part in parts)
