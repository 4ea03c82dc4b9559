"""Twenty-four hours of modal estimates of twenty-four turbines, kept in a file.

The independent simulator (`tests.outside`) drew them once, six windows of ten minutes of each
truth. They are kept because a contract needs one input that no change of any code moves:

    python -m tests.acceptance.cached_day

draws both files again. A covariance is kept by its standard deviations alone, which is what the
default likelihood uses of it.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from pipeline.messages import ModalEstimate, Mode
from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import FloatArray
from tests.outside.figures import Figures, draw
from tests.outside.modal_data import (
    DURATION,
    HIGHEST,
    IDENTIFIED,
    LAYOUT,
    LOWEST,
    Truth,
    estimates,
)
from tests.outside.model import NOMINAL, averaged

FOLDER = Path(__file__).parent / "days"
HOURS, WINDOWS = 24, 6
SEED = 20261122  # of the files; no threshold or prior was chosen on what it draws
KINDS = ("known", "uncertain")  # the structure: as described, or every figure from its prior


@dataclass(frozen=True, slots=True, eq=False)
class Hour:
    """Six windows of one turbine and its true springs."""

    theta: FloatArray
    """k11 [N/m], k22 [N·m/rad], k12 [N/rad], (3,)."""
    estimates: tuple[ModalEstimate, ...]


def drawn_day(kind: str, hours: Iterable[int] = range(HOURS)) -> list[Hour]:
    """Draw hours anew, as they are in the file."""
    return [_drawn_hour(kind, np.random.default_rng([SEED, KINDS.index(kind), hour]))
            for hour in hours]  # fmt: skip


def _drawn_hour(kind: str, rng: np.random.Generator) -> Hour:
    figures = Figures() if kind == "known" else draw(rng)
    theta = NOMINAL * rng.uniform(LOWEST, HIGHEST, 3)
    while theta[0] * theta[1] <= 1.02 * theta[2] ** 2:  # stable under the tower's own weight
        theta = NOMINAL * rng.uniform(LOWEST, HIGHEST, 3)
    truth = Truth(theta, figures, description=averaged())
    drawn = estimates(truth, WINDOWS, rng, errors=IDENTIFIED)
    return Hour(theta, tuple(replace(each, modes=_rounded(each.modes)) for each in drawn))


def _rounded(modes: Sequence[Mode]) -> tuple[Mode, ...]:
    """The modes as they come back from the file."""
    rows, pairs = _table(modes)
    return _modes(rows, pairs, modes[0].n_block_columns) if modes else ()


def _table(modes: Sequence[Mode]) -> tuple[FloatArray, list[str]]:
    """(n_modes, 2 + n_channels, 2): values and stds of f, ζ, φ; and the pairs they belong to."""
    rows = [
        np.column_stack(
            [
                [mode.frequency, mode.damping_ratio, *mode.shape],
                np.linalg.norm(mode.covariance_factor, axis=1),
            ]
        )
        for mode in modes
    ]
    return np.array(rows, dtype=np.float32).astype(float), [mode.pair_id for mode in modes]


def _modes(table: FloatArray, pairs: Sequence[str], n_blocks: int) -> tuple[Mode, ...]:
    modes = []
    for values, pair_id in zip(table, pairs, strict=True):
        factor = np.zeros((len(values), n_blocks))
        np.fill_diagonal(factor, values[:, 1])
        modes.append(
            Mode(
                name=f"m{len(modes) + 1}",
                frequency=float(values[0, 0]),
                frequency_std=float(values[0, 1]),
                damping_ratio=float(values[1, 0]),
                damping_ratio_std=float(values[1, 1]),
                shape=values[2:, 0].copy(),
                covariance_factor=factor,
                n_block_columns=n_blocks,
                pair_id=pair_id,
            )
        )
    return tuple(modes)


def write_day(kind: str) -> Path:
    """Write the file of a kind."""
    day = drawn_day(kind)
    windows = [each for hour in day for each in hour.estimates]
    tables = [_table(each.modes) for each in windows]
    path = FOLDER / f"{kind}.npz"
    path.parent.mkdir(exist_ok=True)
    np.savez_compressed(
        path,
        theta=np.array([hour.theta for hour in day]),
        n_modes=np.array([len(each.modes) for each in windows], dtype=np.int16),
        tables=np.concatenate([table for table, _ in tables]).astype(np.float32),
        pairs=np.array([pair for _, pairs in tables for pair in pairs]),
        n_blocks=np.array(windows[0].modes[0].n_block_columns),
    )
    return path


def cached_day(kind: str) -> list[Hour]:
    """Read the hours of a kind."""
    with np.load(FOLDER / f"{kind}.npz") as kept:
        theta, n_modes, n_blocks = kept["theta"], kept["n_modes"], int(kept["n_blocks"])
        tables, pairs = kept["tables"].astype(float), kept["pairs"].tolist()
    ends = np.cumsum(n_modes)
    windows = [
        _estimate(number % WINDOWS, _modes(tables[end - n : end], pairs[end - n : end], n_blocks))
        for number, (end, n) in enumerate(zip(ends.tolist(), n_modes.tolist(), strict=True))
    ]
    return [
        Hour(theta[hour], tuple(windows[WINDOWS * hour : WINDOWS * (hour + 1)]))
        for hour in range(HOURS)
    ]


def _estimate(window: int, modes: tuple[Mode, ...]) -> ModalEstimate:
    return ModalEstimate(
        turbine=LAYOUT.turbine,
        window=window,
        start_ns=round(window * DURATION * NANOSECONDS),
        end_ns=round((window + 1) * DURATION * NANOSECONDS),
        layout_id=LAYOUT.layout_id,
        channels=LAYOUT.channel_names,
        modes=modes,
    )


if __name__ == "__main__":
    for each in KINDS:
        print(write_day(each))  # noqa: T201  # a command's output
