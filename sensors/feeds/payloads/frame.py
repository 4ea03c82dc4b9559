"""A block of float32 samples as bytes, for UDP and MQTT: small enough for a data logger.

offset  bytes                                                        little endian
  0     4   "PWB1"
  4     2   flags         uint16: 1 = a signature stands at the end; the others are 0
  6     2   status        uint16: 1 clipped, 2 clock unsynchronised, 4 sensor fault
  8     2   names_length  uint16 [bytes]
 10     2   n_channels    uint16
 12     4   n_samples     uint32, of each channel
 16     8   sequence      uint64: counts the frames of a session, one by one
 24     8   session       uint64: another one, and a higher one, whenever the sender starts,
                          such as the time of its start
 32     8   start_ns      uint64: the first sample's time [ns since 1970-01-01 UTC]
 40     8   sampling_rate float64 [Hz]
 48     …   names         UTF-8, separated by "," (0 bytes: all channels of the layout, in order)
  …     …   samples       float32, all channels of the first sample, then of the second …
  …    32   signature     HMAC-SHA256 (RFC 2104) of all bytes before it, where a key is shared
"""

import hashlib
import hmac
import struct
from dataclasses import dataclass

import numpy as np

from sensors.acquisition.blocks import BlockStatus
from sensors.arrays import FloatArray
from sensors.feeds.payloads.timestamps import LATEST_NS

FRAME_MAGIC = b"PWB1"
HEADER = struct.Struct("<4sHHHHIQQQd")
SIGNED = 1
SIGNATURE_BYTES = 32
LARGEST_FRAME = 2**20  # [bytes]: a second of 25 channels at 10 kHz
LOWEST_RATE, HIGHEST_RATE = 1e-3, 1e6  # [Hz]


class FrameError(ValueError):
    """Bytes that are no frame, or not one of a sender that has the key."""


class ForgedFrame(FrameError):  # noqa: N818  # the name states what it is
    """A frame without the signature that the key gives."""


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """What a frame holds."""

    sequence: int
    session: int
    start_ns: int
    """Time of the first sample [ns since 1970-01-01 UTC]."""
    sampling_rate: float
    """Sampling rate [Hz]."""
    samples: FloatArray
    """(n_samples, n_channels)."""
    names: tuple[str, ...] = ()
    """Empty: all channels of the layout, in its order."""
    status: BlockStatus = BlockStatus.OK


def encoded(frame: Frame, key: bytes = b"") -> bytes:
    """The bytes of a frame; signed where there is a key."""
    names = ",".join(frame.names).encode()
    n_samples, n_channels = frame.samples.shape
    header = HEADER.pack(
        FRAME_MAGIC,
        SIGNED if key else 0,
        int(frame.status),
        len(names),
        n_channels,
        n_samples,
        frame.sequence,
        frame.session,
        frame.start_ns,
        frame.sampling_rate,
    )
    body = header + names + frame.samples.astype("<f4").tobytes()
    return body + (hmac.digest(key, body, hashlib.sha256) if key else b"")


def decoded(payload: bytes, key: bytes = b"") -> Frame:
    """The frame in some bytes.

    Parameters
    ----------
    payload : bytes
        As they came.
    key : bytes, optional
        Shared with the senders; b"" where there is none.

    Raises
    ------
    FrameError
        In one sentence, where there is none.
    ForgedFrame
        If a key is shared and the signature is missing or another.
    """
    _require(len(payload) <= LARGEST_FRAME, f"{len(payload)} bytes; at most {LARGEST_FRAME}")
    _require(payload[:4] == FRAME_MAGIC, f"begins with {payload[:4]!r}, not with {FRAME_MAGIC!r}")
    _require(len(payload) >= HEADER.size, f"{len(payload)} bytes; a header has {HEADER.size}")
    _, flags, status, names_length, n_channels, n_samples, *numbers, rate = HEADER.unpack_from(
        payload
    )
    signature = SIGNATURE_BYTES if flags & SIGNED else 0
    size = HEADER.size + names_length + 4 * n_channels * n_samples + signature
    _require(len(payload) == size, f"{len(payload)} bytes; its header tells of {size}")
    if key:
        _check_signature(payload, flags, key)
    sequence, session, start_ns = numbers
    _require(
        LOWEST_RATE <= rate <= HIGHEST_RATE,
        f"sampling_rate is {rate} Hz; {LOWEST_RATE:g} to {HIGHEST_RATE:g}",
    )
    _require(start_ns < LATEST_NS, f"start_ns is {start_ns}, behind the year 2096")
    _require(n_channels * n_samples > 0, f"{n_samples} samples of {n_channels} channels")
    names = _names(payload[HEADER.size :][:names_length])
    _require(not names or len(names) == n_channels, f"{len(names)} names for {n_channels} channels")
    samples = np.frombuffer(
        payload, dtype="<f4", count=n_channels * n_samples, offset=HEADER.size + names_length
    )
    return Frame(
        sequence,
        session,
        start_ns,
        rate,
        samples.reshape(n_samples, n_channels).astype(np.float64),
        names,
        BlockStatus(status & 7),
    )


def _check_signature(payload: bytes, flags: int, key: bytes) -> None:
    if not flags & SIGNED:
        raise ForgedFrame("a frame without a signature, where a key is shared")
    body, signature = payload[:-SIGNATURE_BYTES], payload[-SIGNATURE_BYTES:]
    if not hmac.compare_digest(hmac.digest(key, body, hashlib.sha256), signature):
        raise ForgedFrame("a frame whose signature is not of the shared key")


def _names(written: bytes) -> tuple[str, ...]:
    try:
        return tuple(written.decode().split(",")) if written else ()
    except UnicodeDecodeError as error:
        raise FrameError(f"names are not UTF-8: {written[:40]!r}") from error


def _require(holds: bool, sentence: str) -> None:
    if not holds:
        raise FrameError(sentence)
