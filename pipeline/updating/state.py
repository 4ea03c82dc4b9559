"""What the updating remembers between windows, and how it is kept as bytes.

    pilewatch-updating 3\n      what it is and the version of its layout, readable
    CRC-32 of the rest          4 bytes, big-endian
    zlib(                       the rest
        length of the tree      4 bytes, big-endian
        tree                    JSON: whose state it is, and the state; {"array": i} for an array
        arrays                  one after the other, little-endian float64
    )

Numbers come back bit by bit. Random state needs no place in it: each window's generator is seeded
by the scenario's seed and the window's number.
"""

import json
import struct
import types
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, asdict, dataclass, field, fields, is_dataclass, replace
from functools import reduce
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from pipeline.messages import ModalEstimate
from pipeline.updating.change.detector import ChangeState
from pipeline.updating.change.event_message import TrackSensitivity
from pipeline.updating.change.revised_size import BeforeEvent
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import ModeObservation, SeenWindow, diagonal
from pipeline.updating.structural.alternatives import WarmStart
from pipeline.updating.structural.joint_fit import FINEST_TOLERANCE
from sensors.arrays import FloatArray
from sensors.errors import InputError

RECENT_WINDOWS = 36  # that are kept one by one: six hours of ten minutes
STATE_HEADER = b"pilewatch-updating"
STATE_VERSION = 3  # of the layout; another one is refused, never guessed at
LARGEST_STATE = 256 * 2**20  # [bytes] unpacked; a state of a hundred modes has some 10⁶

S = TypeVar("S")


@dataclass(frozen=True, slots=True, eq=False)
class UpdatingState:
    """All that is remembered between windows; its size doesn't grow with their number."""

    evidence: ModalEvidence
    ensemble: FloatArray | None = None  # (n, 3) ratios drawn from the last posterior; what else
    # is uncertain beside it
    median: FloatArray | None = None  # (3,) ratios, of the last posterior
    change: ChangeState = field(default_factory=ChangeState)
    recent: tuple[SeenWindow, ...] = ()  # from which the evidence starts again after a change
    sensitivities: tuple[TrackSensitivity, ...] = ()  # of the last posterior's pairs
    joint: tuple[WarmStart, ...] = ()  # of each alternative of an uncertain structure, best first
    sensor_fault: str = ""  # name of the one that the last posterior found
    reference: ModalEvidence | None = None  # of the windows before the last event
    reference_ns: int = 0  # start of the last of them
    before_event: BeforeEvent | None = None  # by which the last event's size is revised

    @property
    def is_rough(self) -> bool:
        """Whether the last posterior found that the description does not hold."""
        return bool(self.joint) and self.joint[0].tolerance > FINEST_TOLERANCE

    def with_window(
        self, estimate: ModalEstimate, seen: Sequence[ModeObservation], rise: float
    ) -> "UpdatingState":
        """One more window's modes in the evidence, and among the recent windows.

        Where correlations aren't used, variances are all that is kept of a recent covariance.
        """
        latest = SeenWindow.of(estimate, seen, rise)
        evidence = self.evidence.with_window(latest)
        if not evidence.joint_covariance:
            latest = replace(latest, sightings=tuple(map(diagonal, seen)))
        return replace(self, evidence=evidence, recent=(*self.recent, latest)[-RECENT_WINDOWS:])

    def begun_anew(self, start_ns: int, nothing: ModalEvidence) -> "UpdatingState":
        """With the evidence of the recent windows alone that began at that time or later; their
        modes keep the tracks they had. nothing: evidence without a window.

        Where the structure is uncertain, the recent windows before that time become the reference
        that later posteriors are compared with.
        """
        evidence = replace(nothing, n_tracks=self.evidence.n_tracks)
        recent = tuple(each for each in self.recent if each.start_ns >= start_ns)
        before = tuple(each for each in self.recent if each.start_ns < start_ns)
        reference = self.reference
        if before and self.joint:
            reference = _summed(before, replace(nothing, n_tracks=self.evidence.n_tracks))
        return replace(
            self,
            evidence=_summed(recent, evidence).with_tracks_of(self.evidence),
            recent=recent,
            reference=reference,
            reference_ns=before[-1].start_ns if before else self.reference_ns,
        )


def _summed(windows: Sequence[SeenWindow], evidence: ModalEvidence) -> ModalEvidence:
    return reduce(ModalEvidence.with_window, windows, evidence)


class CheckpointError(InputError):
    """A checkpoint that this updater cannot continue from; the message states which and why."""


@dataclass(frozen=True, slots=True)
class CheckpointOwner:
    """Whose state it is. A state continues only with the same turbine, springs and sensors."""

    turbine: str
    channels: tuple[str, ...]
    nominal: tuple[float, float, float]  # k11 [N/m], k22 [N·m/rad], k12 [N/rad]


def encoded_checkpoint(state: Any, owner: CheckpointOwner) -> bytes:
    """A state, a frozen dataclass of numbers, texts, arrays and the like, with its owner."""
    arrays: list[FloatArray] = []
    tree = json.dumps({"owner": asdict(owner), "state": _tree(state, arrays)}).encode()
    blob = b"".join(np.ascontiguousarray(each, dtype="<f8").tobytes() for each in arrays)
    packed = zlib.compress(struct.pack(">I", len(tree)) + tree + blob)
    return (
        b"%s %d\n" % (STATE_HEADER, STATE_VERSION) + struct.pack(">I", zlib.crc32(packed)) + packed
    )


def decoded_checkpoint(
    payload: bytes, state_type: type[S], owner: CheckpointOwner, *, origin: str = "checkpoint"
) -> S:
    """The state that `encoded_checkpoint` wrote.

    owner    who asks for it
    origin   where the bytes came from, for the error

    Raises CheckpointError: no checkpoint, another version, damaged, another turbine's.
    """
    tree, blob = _unpacked(payload, origin)
    try:
        written = CheckpointOwner(
            turbine=tree["owner"]["turbine"],
            channels=tuple(tree["owner"]["channels"]),
            nominal=tuple(tree["owner"]["nominal"]),
        )
        _check_owner(written, owner, origin)
        state: S = _value(tree["state"], state_type, _Arrays(blob))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise CheckpointError(f"{origin} is damaged: {error}") from error
    return state


def _unpacked(payload: bytes, origin: str) -> tuple[Mapping[str, Any], bytes]:
    """The JSON tree and the arrays' bytes."""
    line, _, _ = payload[:64].partition(b"\n")
    kind, _, version = line.partition(b" ")
    if kind != STATE_HEADER or not version.isdigit():
        raise CheckpointError(
            f"{origin} begins with {payload[:20]!r}: it is no checkpoint of the updating"
        )
    if int(version) != STATE_VERSION:
        raise CheckpointError(
            f"{origin} has version {int(version)} of the checkpoint's layout; this pilewatch "
            f"reads version {STATE_VERSION}"
        )
    body = payload[len(line) + 1 :]
    if len(body) < 4 or struct.unpack(">I", body[:4])[0] != zlib.crc32(body[4:]):
        raise CheckpointError(f"{origin} is damaged: {len(payload)} bytes with a wrong check sum")
    unpacked = zlib.decompressobj().decompress(body[4:], LARGEST_STATE)
    (length,) = struct.unpack(">I", unpacked[:4])
    return json.loads(unpacked[4 : 4 + length]), unpacked[4 + length :]


def _check_owner(written: CheckpointOwner, asking: CheckpointOwner, origin: str) -> None:
    for name, unit in (("turbine", ""), ("nominal", " N/m, N·m/rad, N/rad"), ("channels", "")):
        theirs, ours = getattr(written, name), getattr(asking, name)
        if theirs != ours:
            word = "nominal springs" if name == "nominal" else name
            raise CheckpointError(
                f"{origin} is of {word} {_listed(theirs)}{unit}, not of {_listed(ours)}{unit}"
            )


def _listed(value: str | Sequence[Any]) -> str:
    if isinstance(value, str):
        return repr(value)
    return ", ".join(f"{each:g}" if isinstance(each, float) else str(each) for each in value)


def _tree(value: Any, arrays: list[FloatArray]) -> Any:
    """What JSON can hold; arrays go to the list."""
    if is_dataclass(value):
        return {field.name: _tree(getattr(value, field.name), arrays) for field in fields(value)}
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1, "shape": value.shape}
    if isinstance(value, tuple):
        return [_tree(each, arrays) for each in value]
    if isinstance(value, np.generic):
        return value.item()
    return value


class _Arrays:
    """The arrays' bytes, taken one after the other."""

    def __init__(self, blob: bytes) -> None:
        self._numbers = np.frombuffer(blob, dtype="<f8")
        self._taken = 0

    def next(self, shape: Sequence[int]) -> FloatArray:
        size = int(np.prod(shape))
        found = self._numbers[self._taken : self._taken + size]
        self._taken += size
        return found.reshape(shape).astype(float)  # a copy that may be written to


def _has_default(field: Field[Any]) -> bool:
    return field.default is not MISSING or field.default_factory is not MISSING


def _value(tree: Any, hint: Any, arrays: _Arrays) -> Any:
    """The value of the annotated type; fields are read in the order they were written."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        if tree is None:
            return None
        (hint,) = (each for each in arguments if each is not type(None))
        return _value(tree, hint, arrays)
    if origin is tuple:
        hints = (arguments[0],) * len(tree) if arguments[-1] is Ellipsis else arguments
        return tuple(_value(each, inner, arrays) for each, inner in zip(tree, hints, strict=True))
    if origin is np.ndarray:
        return arrays.next(tree["shape"])
    if is_dataclass(hint) and isinstance(hint, type):
        types_of = get_type_hints(hint)
        values = {
            f.name: _value(tree[f.name], types_of[f.name], arrays)
            for f in fields(hint)
            if f.name in tree or not _has_default(f)  # a state from before the field was added
        }
        return hint(**values)
    return hint(tree)
