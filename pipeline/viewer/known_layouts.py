"""The sensor layouts of one turbine, as its acquisition units announce them."""

from pipeline.messages import FoundationPosterior, ModalEstimate
from sensors.acquisition.layout import SensorLayout, joined_layout


class KnownLayouts:
    """Layouts by name, the newest of each unit last; also that of all units together."""

    def __init__(self) -> None:
        self._by_id: dict[str, SensorLayout] = {}

    def add(self, layout: SensorLayout) -> None:
        """Add a layout; it replaces an earlier one with the same id."""
        self._by_id[layout.layout_id] = layout

    @property
    def all(self) -> tuple[SensorLayout, ...]:
        """Every layout, in the order of arrival."""
        return tuple(self._by_id.values())

    def named(self, layout_id: str) -> SensorLayout | None:
        """Return a unit's layout, or that of all units together under their joined name."""
        if layout_id in self._by_id or not self._by_id:
            return self._by_id.get(layout_id)
        units = {layout.unit: layout for layout in self.all}  # the newest of each unit
        joined = joined_layout([units[unit] for unit in sorted(units)])
        return joined if joined.layout_id == layout_id else None

    def of_posterior(
        self, posterior: FoundationPosterior, estimate: ModalEstimate | None
    ) -> SensorLayout | None:
        """Return the layout whose channels the model's shapes have: the estimate's, else any."""
        names = [estimate.layout_id] if estimate else list(self._by_id)
        layouts = [found for name in names if (found := self.named(name)) is not None]
        n_channels = posterior.model_shapes.shape[1]
        return next((one for one in layouts if len(one.channels) == n_channels), None)
