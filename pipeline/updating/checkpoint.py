"""A state of frozen dataclasses, numbers, texts and arrays as bytes, with whose it is.

    pilewatch-updating 3\n      what it is and the version of its layout, readable
    CRC-32 of the rest          4 bytes, big-endian
    zlib(                       the rest
        length of the tree      4 bytes, big-endian
        tree                    JSON: whose state it is, and the state; {"array": i} for an array
        arrays                  one after the other, little-endian float64
    )

Numbers come back bit by bit.
"""

import json
import struct
import types
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, Field, asdict, dataclass, fields, is_dataclass
from functools import cache
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

import numpy as np

from sensors.arrays import FloatArray
from sensors.errors import InputError

STATE_HEADER = b"pilewatch-updating"
STATE_VERSION = 3  # of the layout; another one is refused, never guessed at
LARGEST_STATE = 256 * 2**20  # [bytes] unpacked; a state of a hundred modes has some 10⁶
STORED_AS = "stored_as"  # metadata of a field that has another name in the file

S = TypeVar("S")


class CheckpointError(InputError):
    """A checkpoint that this updater cannot continue from; the message states which and why."""


@dataclass(frozen=True, slots=True)
class CheckpointOwner:
    """Whose state it is. A state continues only with the same turbine, springs and sensors."""

    turbine: str
    channels: tuple[str, ...]
    nominal: tuple[float, float, float]
    """k11 [N/m], k22 [N·m/rad], k12 [N/rad]."""


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

    Parameters
    ----------
    payload : bytes
        The checkpoint.
    state_type : type
        Of the state.
    owner : CheckpointOwner
        Who asks for it.
    origin : str, optional
        Where the bytes came from, for the error.

    Raises
    ------
    CheckpointError
        If it is no checkpoint, another version's, damaged, or another turbine's.
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
    except CheckpointError:
        raise
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise CheckpointError(f"{origin} is damaged: {error}; start with --fresh") from error
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
                f"{origin} is of {word} {_listed(theirs)}{unit}, not of {_listed(ours)}{unit}; "
                "start with --fresh"
            )


def _listed(value: str | Sequence[Any]) -> str:
    if isinstance(value, str):
        return repr(value)
    return ", ".join(f"{each:g}" if isinstance(each, float) else str(each) for each in value)


def _tree(value: Any, arrays: list[FloatArray]) -> Any:
    """What JSON can hold; arrays go to the list."""
    if is_dataclass(value):
        return {_key(field): _tree(getattr(value, field.name), arrays) for field in fields(value)}
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


def _key(field: Field[Any]) -> str:
    return str(field.metadata.get(STORED_AS, field.name))


def _has_default(field: Field[Any]) -> bool:
    return field.default is not MISSING or field.default_factory is not MISSING


@cache
def _types_of(kind: type) -> dict[str, Any]:
    """Types of a dataclass's fields; a state holds thousands of them."""
    return get_type_hints(kind)


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
        types_of = _types_of(hint)
        values = {
            f.name: _value(tree[_key(f)], types_of[f.name], arrays)
            for f in fields(hint)
            if _key(f) in tree or not _has_default(f)  # a state from before the field was added
        }
        return hint(**values)
    return hint(tree)
