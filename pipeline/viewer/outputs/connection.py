"""Open and close a Rerun recording stream to a file or a viewer."""

import logging
import socket
import threading
from pathlib import Path
from urllib.parse import urlsplit

import rerun as rr

from pipeline.viewer.outputs.outputs import (
    DEFAULT_PORT,
    ConnectedViewer,
    RrdFile,
    SpawnedViewer,
    ViewerError,
    ViewerOutput,
)
from pipeline.viewer.outputs.viewer_process import spawn_viewer

APPLICATION = "pilewatch"
CONNECT_TIMEOUT = 3.0  # for a running viewer to answer [s]
CLOSE_TIMEOUT = 5.0  # for an output to close, flushed or not [s]
# Interval between flushes to a file [s]. A kill loses at most this much of the drawings, which the
# recording can draw again.
FILE_TICK = 3600.0
_log = logging.getLogger(__name__)


def open_recording(output: ViewerOutput, *, recording_id: str) -> rr.RecordingStream:
    """Open a stream to one output; raise ViewerError where it cannot be reached or written."""
    sink = _sink(output)
    recording = rr.RecordingStream(
        APPLICATION, recording_id=recording_id, batcher_config=_batching(output)
    )
    recording.set_log_time_enabled(False)  # sensor time only: the machine's would stretch the axis
    recording.set_log_tick_enabled(False)
    recording.set_sinks(sink)
    recording.send_recording_name(recording_id)
    return recording


def _batching(output: ViewerOutput) -> rr.ChunkBatcherConfig:
    """Return how long rows are gathered before they are sent.

    Every chunk costs about 2 kB in a file, whatever its size; to a viewer rows go at once.
    """
    if isinstance(output, RrdFile):
        return rr.ChunkBatcherConfig(flush_tick=FILE_TICK)
    return rr.ChunkBatcherConfig.LOW_LATENCY()


def _sink(output: ViewerOutput) -> rr.FileSink | rr.GrpcSink:
    match output:
        case RrdFile():
            return _file_sink(output)
        case SpawnedViewer(port):
            return rr.GrpcSink(spawn_viewer(port))
        case ConnectedViewer(url):
            _require_viewer(url)
            return rr.GrpcSink(url)


def _require_viewer(url: str) -> None:
    address = urlsplit(url)
    port = address.port or DEFAULT_PORT
    try:
        socket.create_connection((address.hostname or "", port), timeout=CONNECT_TIMEOUT).close()
    except OSError as error:
        raise ViewerError(
            f"--view connect={url}: no viewer listens there ({error.strerror or error}); "
            f"start one with: rerun --bind 127.0.0.1 --port {port}"
        ) from error


def _file_sink(output: RrdFile) -> rr.FileSink:
    path = output.path
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
    except OSError as error:
        raise ViewerError(f"{path}: cannot be written ({error.strerror})") from error
    return rr.FileSink(path, write_footer=output.indexed)


def free_path(path: Path) -> Path:
    """Return the path, or the first of `name-2`, `name-3`, … that is free."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free


def close_recording(recording: rr.RecordingStream, *, timeout: float) -> None:
    """Send what is buffered, within `timeout` [s], and close the outputs.

    An output that cannot be closed is abandoned: the SDK waits forever for a file on a full disk.
    """
    try:
        recording.flush(timeout_sec=timeout)
    except (RuntimeError, ValueError) as error:
        _log.warning("the viewer did not accept the last messages: %s", error)
    closing = threading.Thread(target=recording.disconnect, name="closing", daemon=True)
    closing.start()
    closing.join(CLOSE_TIMEOUT)
    if closing.is_alive():
        forget_unfinished()


def forget_unfinished() -> None:
    """Do not wait at the end of this process for viewers that have not accepted everything.

    The SDK flushes every stream at exit and would wait for a frozen viewer forever. Streams to
    files are flushed by then: `close_recording` did it.
    """
    rr.unregister_shutdown()
