"""A running summary of one turbine as text and status indicators. No rerun here."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    NodeStatus,
    StreamGap,
    WindowRejected,
)
from pipeline.state.phrases import codes_in_words, count_noun
from pipeline.state.posterior_json import (
    ROUGH,
    STIFFNESSES,
    plus_minus,
    ratios,
    widest_half_width,
)
from pipeline.state.turbine_state import TurbineState
from sensors.acquisition.blocks import NANOSECONDS

CHANGE_TEXTS = {  # text of the indicator by kind of change
    "foundation": "foundation: changed",
    "modal-drift": "foundation: known, but the modes changed",
    "undecided": "foundation: perhaps changed",
}
_LISTED = 5  # rejected windows and gaps shown, the newest
CUT_SHORT = "short"  # code of the window in which the session ended: not a fault


@dataclass(frozen=True, slots=True)
class StatusIndicator:
    """One of a turbine's three status indicators, with its text."""

    state: Literal["good", "warning", "bad", "unknown"]
    text: str


class SessionStatus:
    """What the status text of one turbine needs; bounded, however long the session."""

    def __init__(self, turbine: str, *, title: str = "", has_structure: bool = True) -> None:
        self._has_structure = has_structure
        self.turbine = turbine
        self._heading = f"{title} ({turbine})" if title and title != turbine else turbine
        self.state = TurbineState.bounded(turbine, kept=_LISTED)

    def take(self, message: Message) -> None:
        """Take one message of the turbine into account."""
        self.state.fold(message)

    def take_node(self, node: NodeStatus) -> bool:
        """Keep a node's status; return whether its state, losses or kinds of warnings changed."""
        before = self.state.statuses.get(node.node)
        self.state.fold(node)
        return before is None or _reported_state(before) != _reported_state(node)

    @property
    def _event(self) -> FoundationEvent | None:
        """The latest change."""
        return self.state.events[-1] if self.state.events else None

    def _change(self) -> list[str]:
        if self._event is None:
            return []
        revised = self.state.revised_size(self._event)
        first = f"**Changed:** {self._event.text}"
        return [first] if revised is None else [first, revised.text]

    @property
    def indicators(self) -> tuple[StatusIndicator, StatusIndicator, StatusIndicator]:
        """Measurements, modes, foundation."""
        return self._measurements_indicator(), self._modes_indicator(), self._foundation_indicator()

    def markdown(self) -> str:
        """Return the state of the foundation: summary, figures, warnings, changes."""
        parts = (
            [f"### {self._heading}", f"**{self._summary()}**"],
            self._change(),
            self._foundation(),
            self._warnings(),
        )
        return "\n\n".join(paragraph for part in parts for paragraph in part)

    @property
    def lists_nodes(self) -> bool:
        """Whether nodes report under the turbine's name."""
        return bool(self.state.statuses)

    def health_markdown(self) -> str:
        """Return the state of the measurements: windows, gaps, nodes."""
        return "\n\n".join([*self._windows(), *self._node_table()])

    def _measurements_indicator(self) -> StatusIndicator:
        lost = sum(node.lost for node in self.state.statuses.values())
        if self.state.n_gaps or lost:
            text = f"measurements: {count_noun(self.state.n_gaps, 'gap')}"
            return StatusIndicator("warning", text + f", {lost} lost" * bool(lost))
        if self.state.estimate is None and not self.state.rejections:
            return StatusIndicator("unknown", "measurements: no complete window yet")
        return StatusIndicator("good", "measurements: complete")

    def _modes_indicator(self) -> StatusIndicator:
        last = self.state.last_answer
        if isinstance(last, WindowRejected) and last.code != CUT_SHORT:
            return StatusIndicator("bad", "modes: the last window was rejected")
        if self.state.estimate is None:
            return StatusIndicator("unknown", "modes: none yet")
        found = count_noun(len(self.state.estimate.modes), "mode")
        if codes := {each.code: None for each in self.state.estimate.warnings}:
            return StatusIndicator("warning", f"{found}; {', '.join(codes)}")
        return StatusIndicator("good", f"{found} in the last window")

    def _foundation_indicator(self) -> StatusIndicator:
        if not self._has_structure:
            return StatusIndicator("unknown", "foundation: no structural model")
        if self.state.posterior is None:
            return StatusIndicator("unknown", "foundation: no posterior yet")
        if not self.state.posterior.trusted:
            return StatusIndicator("bad", "foundation: NOT TRUSTED")
        if self._event is not None:
            return StatusIndicator(
                "warning", CHANGE_TEXTS.get(self._event.kind, CHANGE_TEXTS["undecided"])
            )
        return StatusIndicator("good", f"foundation: {_known(self.state.posterior)}")

    def _summary(self) -> str:
        posterior = self.state.posterior
        if not self._has_structure:
            if self.state.estimate is None:
                return "Modes only: no window is identified yet."
            found = frequencies_text([mode.frequency for mode in self.state.estimate.modes])
            return f"Modes only: {found} in the last window."
        if posterior is None:
            return "No posterior yet: it comes with the first window whose modes are paired."
        if not posterior.trusted:
            return "NOT TRUSTED: the data contradict the model; do not use these stiffnesses."
        median, low, high = ratios(posterior.parameter("k22"))
        return (
            f"Foundation {_known(posterior)}: rotational stiffness k22 is {median:.3f} × nominal, "
            f"90 % interval {low:.3f} to {high:.3f}."
        )

    def _foundation(self) -> list[str]:
        posterior = self.state.posterior
        if posterior is None:
            return []
        rows = ["| ÷ nominal | median | 90 % interval | truth |", "|---|---|---|---|"]
        for name in STIFFNESSES:
            k = posterior.parameter(name)
            median, low, high = ratios(k)
            true = self.state.truth
            truth = f"{getattr(true, name) / k.nominal:.3f}" if true else "–"
            rows.append(f"| {name} | {median:.3f} | {low:.3f} … {high:.3f} | {truth} |")
        sigma = posterior.parameter("sigma")
        rows.append(f"| σ [-] | {sigma.median:.4f} | below {sigma.p95:.4f} (95 %) | – |")
        rhat = f"R̂ {posterior.rhat:.3f}, " if posterior.rhat == posterior.rhat else ""
        fit = (
            f"{count_noun(posterior.n_windows, 'window')}, "
            f"until {clock_time(posterior.time_ns)} UTC. "
            f"Fit: χ² {posterior.reduced_chi_square:.2f}, "
            f"{100 * posterior.paired_share:.0f} % of identified modes paired. "
            f"Sampler: {rhat}ESS {posterior.ess:.0f}."
        )
        return ["\n".join(rows), fit]

    def _windows(self) -> list[str]:
        state = self.state
        found = f", {len(state.estimate.modes)} modes in the last" if state.estimate else ""
        lines = [
            f"- {state.received[ModalEstimate.__name__]} identified{found}",
            self._rejected_line(),
            *(f"  - {clock_time(window.start_ns)}: {window.reason}" for window in state.rejected),
            f"- {count_noun(state.n_gaps, 'gap')} in the stream, {state.missing:.1f} s in all",
            *(f"  - {gap_text(gap)}" for gap in state.gaps),
        ]
        return ["#### Windows", "\n".join(lines)]

    def _rejected_line(self) -> str:
        """'- 7 rejected, or identified and not used: 3 × gap, …; the last 5:'."""
        if not self.state.n_rejected:
            return "- 0 rejected"
        listed = f"; the last {_LISTED}:" if self.state.n_rejected > _LISTED else ""
        codes = codes_in_words(self.state.rejections)  # some of windows that count as identified
        return f"- {self.state.n_rejected} rejected, or identified and not used: {codes}{listed}"

    def _warnings(self) -> list[str]:
        results = (self.state.estimate, self.state.posterior)
        warnings = [warning for result in results if result for warning in result.warnings]
        if not warnings:
            return []
        return [
            "#### Warnings",
            "\n".join(f"- {warning.code}: {warning.text}" for warning in warnings),
        ]

    def _node_table(self) -> list[str]:
        if not self.state.statuses:
            return []
        rows = ["| node | state | lost | late | duplicate | malformed | busy |", "|---" * 7 + "|"]
        rows += [
            f"| {node.node} | {node.state} | {node.lost} | {node.late} | {node.duplicate} "
            f"| {node.malformed} | {node.busy_s:.1f} s |"
            for _, node in sorted(self.state.statuses.items())
        ]
        listed = [  # as code: untrusted text makes neither links nor pictures
            f"- {node.node}: `{warning.text.replace('`', '´')}`"
            for _, node in sorted(self.state.statuses.items())
            for warning in node.warnings
        ]
        return ["#### Nodes", "\n".join(rows), *(["\n".join(listed)] if listed else [])]


def _reported_state(node: NodeStatus) -> tuple[object, ...]:
    """Return the part of a status whose change is drawn."""
    return node.state, node.lost, node.late, {warning.code for warning in node.warnings}


def clock_time(time_ns: int) -> str:
    """Hours, minutes, seconds of a sensor time, UTC."""
    return datetime.fromtimestamp(time_ns // NANOSECONDS, UTC).strftime("%H:%M:%S")


def gap_text(gap: StreamGap) -> str:
    """Return one line about missing blocks."""
    blocks = f"{gap.n_blocks} blocks ({gap.duration:.1f} s) of unit {gap.unit}"
    return f"{clock_time(gap.start_ns)}: {blocks}"


def posterior_text(posterior: FoundationPosterior) -> str:
    """Return one line about a refreshed posterior: medians of k11, k22 and k12, half the widths.

    Of the 90 % intervals. It is as short as the list of events is narrow.
    """
    parts = ", ".join(plus_minus(posterior.parameter(name)) for name in STIFFNESSES)
    return f"k ÷ nominal: {parts}" if posterior.trusted else f"NOT TRUSTED: k {parts}"


def frequencies_text(frequencies: Sequence[float]) -> str:
    """'12 modes, 0.158 to 11.9 Hz', '1 mode, 0.158 Hz' or 'no modes'."""
    if not frequencies:
        return "no modes"
    if len(frequencies) == 1:
        return f"1 mode, {frequencies[0]:.3f} Hz"
    return f"{len(frequencies)} modes, {min(frequencies):.3f} to {max(frequencies):.2f} Hz"


def _known(posterior: FoundationPosterior) -> str:
    """Return "known", or "known roughly" where an interval is wide."""
    return "known roughly" if widest_half_width(posterior) >= ROUGH else "known"
