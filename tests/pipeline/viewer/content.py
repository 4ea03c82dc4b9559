"""What is in a .rrd, read with Rerun's own reader."""

from pathlib import Path
from typing import Any

import numpy as np
from rerun.chunk import RrdReader


class Recorded:
    """The rows of every entity of a recording, in time order."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._chunks = [
            (chunk.entity_path, chunk.is_static, chunk.timeline_names, chunk.to_record_batch())
            for chunk in RrdReader(path).stream().to_chunks()
        ]

    @property
    def entities(self) -> set[str]:
        return {path for path, *_ in self._chunks if not path.startswith("/__")}

    @property
    def timelines(self) -> set[str]:
        return {name for *_, names, _ in self._chunks for name in names}

    @property
    def n_blueprints(self) -> int:
        return len(RrdReader(self.path).blueprints())

    def column(self, entity: str, component: str, *, static: bool = False) -> list[Any]:
        """Values of one component, row by row, e.g. column("/t/status", "TextDocument:text")."""
        rows = []
        for path, is_static, _, batch in self._chunks:
            if path == entity and is_static == static and component in batch.schema.names:
                values = batch.column(component).to_pylist()
                times = [0] * len(values) if static else _nanoseconds(batch)
                rows += zip(times, values, strict=True)
        return [value for _, value in sorted(rows, key=lambda row: row[0])]

    def with_column(self, component: str) -> set[str]:
        """Entities that have one component."""
        return {path for path, *_, batch in self._chunks if component in batch.schema.names}

    def times_ns(self, entity: str) -> np.ndarray:
        """(n_rows,) sensor times of one entity, sorted."""
        times = [
            _nanoseconds(batch)
            for path, is_static, _, batch in self._chunks
            if path == entity and not is_static
        ]
        return np.sort(np.concatenate(times))

    def scalars(self, entity: str) -> np.ndarray:
        """(n_rows, n_series) in time order."""
        return np.array(self.column(entity, "Scalars:scalars"))

    def has_scalars(self, entity: str) -> bool:
        """Whether a plot draws the entity."""
        return bool(self.column(entity, "Scalars:scalars"))

    def series_names(self, entity: str) -> list[str]:
        """Of its lines, or of its points where they are not joined."""
        lines = self.column(entity, "SeriesLines:names", static=True)
        (names,) = lines or self.column(entity, "SeriesPoints:names", static=True)
        return names


def _nanoseconds(batch: Any) -> np.ndarray:
    return batch.column("time").to_numpy(zero_copy_only=False).astype("int64")
