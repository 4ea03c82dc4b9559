"""Viewer: the sink node that shows a session in Rerun while it runs, or writes it to a .rrd."""

import logging
from collections.abc import Iterable, Sequence

from pipeline.messages import (
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    NodeStatus,
    StreamGap,
    WindowRejected,
)
from pipeline.viewer.blueprint import TurbinePanel, session_blueprint
from pipeline.viewer.connection import close_recording, open_recording
from pipeline.viewer.outputs import RrdFile, ViewerOutput
from pipeline.viewer.screen import TO_FILE, TO_VIEWER, TurbineScreen
from sensors.blocks import AccelerationBlock
from sensors.layout import SensorLayout
from sensors.turbine.description import TurbineDescription

_log = logging.getLogger(__name__)


class Viewer:
    """Shows every message; answers with none.

    outputs       where to: files and viewers, at least one
    description   the turbine's geometry and its reference modes
    session       names the recording in the viewer
    strict        True (tests): an exception goes to the caller. False: it is logged once, with its
                  traceback, and the sink is silent from then on, for no picture is worth a
                  session's measurements.

    Raises ViewerError, one line, where an output cannot be had.
    """

    name = "viewer"
    inputs: tuple[type, ...] = (
        AccelerationBlock,
        SensorLayout,
        ModalEstimate,
        WindowRejected,
        FoundationPosterior,
        FoundationTruth,
        StreamGap,
        NodeStatus,
    )

    def __init__(
        self,
        outputs: Sequence[ViewerOutput],
        description: TurbineDescription,
        *,
        session: str,
        strict: bool = False,
    ) -> None:
        self._description = description
        self._strict = strict
        self._silent = False
        headless = all(isinstance(output, RrdFile) for output in outputs)
        self._pace = TO_FILE if headless else TO_VIEWER
        self._patience = 60.0 if headless else 5.0  # for the last of it at the end [s]
        self._recording = open_recording(outputs, recording_id=session)
        self._recording.send_recording_name(session)
        self._screens: dict[str, TurbineScreen] = {}
        self._laid_out: tuple[TurbinePanel, ...] = ()

    def handle(self, message: Message) -> Iterable[Message]:
        """Draw one message; returns nothing."""
        self._guarded(message)
        return ()

    def close(self) -> None:
        """Hand over what waits and let go of file and viewer; a second call does nothing."""
        self._guarded(None)
        close_recording(self._recording, patience=self._patience)
        self._silent = True

    def _guarded(self, message: Message | None) -> None:
        if self._silent:
            return
        try:
            if message is None:
                self._finish()
            else:
                self._show(message)
        except Exception:
            # Why so wide: the pipeline must outlive its pictures, whatever breaks in them.
            if self._strict:
                raise
            self._silent = True
            _log.exception("the viewer failed and shows nothing more; the session goes on")

    def _finish(self) -> None:
        for screen in self._screens.values():
            screen.finish()

    def _show(self, message: Message) -> None:
        screen = self._screen_of(message)
        match message:
            case AccelerationBlock():
                screen.show_block(message)
            case SensorLayout():
                screen.show_layout(message)
            case ModalEstimate():
                screen.show_estimate(message)
            case WindowRejected():
                screen.show_rejection(message)
            case FoundationPosterior():
                screen.show_posterior(message)
            case FoundationTruth():
                screen.show_truth(message)
            case StreamGap():
                screen.show_gap(message)
            case NodeStatus():
                screen.show_node(message)
        self._lay_out()

    def _screen_of(self, message: Message) -> TurbineScreen:
        turbine = message.turbine
        if turbine not in self._screens:
            self._screens[turbine] = TurbineScreen(
                self._recording, turbine, self._description, pace=self._pace
            )
        return self._screens[turbine]

    def _lay_out(self) -> None:
        """Send the blueprint where it would differ: a new turbine, unit or set of modes."""
        panels = tuple(screen.panel for screen in self._screens.values())
        if panels != self._laid_out:
            self._laid_out = panels
            blueprint = session_blueprint(panels, playback_speed=self._pace.playback_speed)
            self._recording.send_blueprint(blueprint)
