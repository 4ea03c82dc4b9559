"""A Rerun recording stream to where it was asked to go: file, started or running viewer."""

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
CONNECT_PATIENCE = 3.0  # for a running viewer to answer [s]
LETTING_GO = 5.0  # of an output that has been flushed, or will never be [s]
# Between two hand-overs to a file [s]. It is what a kill costs the pictures, which the recording
# can draw again; shorter, and the file grows: 30 s instead makes an eighth more.
FILE_TICK = 600.0
_log = logging.getLogger(__name__)


def open_recording(output: ViewerOutput, *, recording_id: str) -> rr.RecordingStream:
    """A stream to one output; ViewerError where it cannot be reached or written."""
    sink = _sink(output)
    recording = rr.RecordingStream(
        APPLICATION, recording_id=recording_id, batcher_config=_batching(output)
    )
    recording.set_log_time_enabled(False)  # sensor time alone: the machine's would stretch the axis
    recording.set_log_tick_enabled(False)
    recording.set_sinks(sink)
    recording.send_recording_name(recording_id)
    return recording


def _batching(output: ViewerOutput) -> rr.ChunkBatcherConfig:
    """How long rows wait for others of their entity before they are handed over.

    Every chunk costs about 2 kB in a file, whatever it holds; a viewer that somebody watches is
    told at once.
    """
    if isinstance(output, RrdFile):
        return rr.ChunkBatcherConfig(flush_tick=FILE_TICK)
    return rr.ChunkBatcherConfig.LOW_LATENCY()


def _sink(output: ViewerOutput) -> rr.FileSink | rr.GrpcSink:
    match output:
        case RrdFile(path):
            return _file_sink(path)
        case SpawnedViewer(port):
            return rr.GrpcSink(spawn_viewer(port))
        case ConnectedViewer(url):
            _require_viewer(url)
            return rr.GrpcSink(url)


def _require_viewer(url: str) -> None:
    address = urlsplit(url)
    port = address.port or DEFAULT_PORT
    try:
        socket.create_connection((address.hostname or "", port), timeout=CONNECT_PATIENCE).close()
    except OSError as error:
        raise ViewerError(
            f"--view connect={url}: no viewer listens there ({error.strerror or error}); "
            f"start one with: rerun --bind 127.0.0.1 --port {port}"
        ) from error


def _file_sink(path: Path) -> rr.FileSink:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.open("ab").close()
    except OSError as error:
        raise ViewerError(f"--rrd {path}: cannot be written ({error.strerror})") from error
    return rr.FileSink(path)


def free_path(path: Path) -> Path:
    """The path, or the first of `name-2`, `name-3`, … that no file has."""
    number, free = 1, path
    while free.exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free


def close_recording(recording: rr.RecordingStream, *, patience: float) -> None:
    """Hand over what is buffered, within `patience` [s], and let go of the outputs.

    An output that cannot be let go of is left behind: the SDK waits for ever for a file that met a
    full disk.
    """
    try:
        recording.flush(timeout_sec=patience)
    except (RuntimeError, ValueError) as error:
        _log.warning("the viewer did not take the last of the session: %s", error)
    letting_go = threading.Thread(target=recording.disconnect, name="letting go", daemon=True)
    letting_go.start()
    letting_go.join(LETTING_GO)
    if letting_go.is_alive():
        forget_unfinished()


def forget_unfinished() -> None:
    """Do not wait, when this process ends, for viewers that have not taken everything.

    The SDK flushes every stream at exit and would wait for a frozen viewer forever. Streams to
    files are flushed by then: `close_recording` did it.
    """
    rr.unregister_shutdown()
