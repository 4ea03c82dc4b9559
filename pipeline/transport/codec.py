"""Messages to bytes and back, by the schema in proto/pilewatch.proto.

The schema's messages carry the names and fields of the Python types, so one walk over the fields
serves them all. A new message needs its type, its entry in the schema, its line in the table
of streams and its check; nothing here.

In protobuf a packed `repeated float` and a `bytes` field look the same on the wire. The wire twin
of the schema declares every run of numbers as bytes, so that an array is copied whole (6 µs a
block instead of half a millisecond); what it writes is read by the original, and the other way
round.
"""

import operator
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntFlag
from functools import cache
from typing import Any, Protocol, TypeVar, get_args, get_type_hints

import numpy as np
from google.protobuf import message_factory
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import DecodeError, EncodeError

from pipeline.messages import Message
from pipeline.transport.checks import check
from pipeline.transport.errors import CodecError
from pipeline.transport.proto import pilewatch_pb2
from sensors.errors import InputError

LARGEST_PAYLOAD = 8 * 2**20  # [bytes]; an hour of eight channels at 40 Hz in one block has 4.6 MB

SCHEMA_NAMES = {"QualityWarning": "Warning"}  # types whose name in the schema is an older one

NUMBER_TYPES: dict[int, np.dtype[Any]] = {
    FieldDescriptorProto.TYPE_FLOAT: np.dtype("<f4"),
    FieldDescriptorProto.TYPE_DOUBLE: np.dtype("<f8"),
}

_M = TypeVar("_M", bound=Message)


def encode(message: Message) -> bytes:
    """Return the message as it travels and is recorded.

    Raises CodecError where a field does not fit the schema or the message contradicts itself.
    """
    try:
        check(message)
        wire = wire_class(type(message).__name__)()
        _write(message, wire)
        return wire.SerializeToString()
    except (EncodeError, ValueError, TypeError, OverflowError) as error:
        raise CodecError(f"{type(message).__name__} cannot be written: {error}") from error


def decode(message_type: type[_M], payload: bytes) -> _M:
    """Return the message of the given type that these bytes hold. Its arrays are read-only views.

    Raises CodecError for anything else, whatever the bytes.
    """
    if len(payload) > LARGEST_PAYLOAD:
        raise CodecError(
            f"{message_type.__name__} of {len(payload)} bytes; the largest allowed has "
            f"{LARGEST_PAYLOAD}"
        )
    try:
        message: _M = _read(message_type, wire_class(message_type.__name__).FromString(payload))
        check(message)
    except (DecodeError, InputError, ValueError, TypeError, OverflowError) as error:
        raise CodecError(f"no {message_type.__name__}: {error}") from error
    return message


class _Field(Protocol):
    """How one field of a message crosses: from its value into the wire message, and back."""

    def write(self, value: Any, wire: Any) -> None: ...
    def read(self, wire: Any) -> Any: ...


def _write(message: Any, wire: Any) -> None:
    message_type: Any = type(message)
    for name, field in _fields(message_type):
        field.write(getattr(message, name), wire)


def _read(message_type: Any, wire: Any) -> Any:
    return message_type(**{name: field.read(wire) for name, field in _fields(message_type)})


@cache
def _fields(message_type: Any) -> tuple[tuple[str, _Field], ...]:
    """(name, crossing) of each field of a message type, paired by name with the schema."""
    name = message_type.__name__
    schema = schema_of_message(SCHEMA_NAMES.get(name, name))
    hints = get_type_hints(message_type)
    return tuple((field.name, _field(field, hints[field.name])) for field in schema.field)


def _field(field: FieldDescriptorProto, hint: Any) -> _Field:
    if is_run_of_numbers(field):
        return _Numbers(field.name, NUMBER_TYPES[field.type], _tuple_length(hint))
    if field.type_name.endswith("Matrix"):
        (values,) = (f for f in schema_of_message(name_of_type(field)).field if f.name == "values")
        return _Matrix(field.name, NUMBER_TYPES[values.type])
    if field.type == FieldDescriptorProto.TYPE_MESSAGE:
        return _Records(field.name, get_args(hint)[0])
    if field.label == FieldDescriptorProto.LABEL_REPEATED:
        return _Strings(field.name)
    if isinstance(hint, type) and issubclass(hint, IntFlag):
        return _Scalar(field.name, operator.index, hint)
    return _Scalar(field.name, _EXACT.get(hint, _unchanged))


def _tuple_length(hint: Any) -> int | None:
    """3 of tuple[float, float, float]; None of an array."""
    arguments = get_args(hint)
    return len(arguments) if arguments and all(a is float for a in arguments) else None


def _unchanged(value: Any) -> Any:
    return value


# NumPy's scalars become Python's; a float never passes for an integer.
_EXACT: dict[Any, Callable[[Any], Any]] = {int: operator.index, float: float, bool: bool}


@dataclass(frozen=True, slots=True)
class _Scalar:
    name: str
    outward: Callable[[Any], Any]
    inward: Callable[[Any], Any] = _unchanged

    def write(self, value: Any, wire: Any) -> None:
        setattr(wire, self.name, self.outward(value))

    def read(self, wire: Any) -> Any:
        return self.inward(getattr(wire, self.name))


@dataclass(frozen=True, slots=True)
class _Strings:
    name: str

    def write(self, value: tuple[str, ...], wire: Any) -> None:
        getattr(wire, self.name).extend(value)

    def read(self, wire: Any) -> tuple[str, ...]:
        return tuple(getattr(wire, self.name))


@dataclass(frozen=True, slots=True)
class _Records:
    name: str
    message_type: type

    def write(self, value: tuple[Any, ...], wire: Any) -> None:
        entries = getattr(wire, self.name)
        for record in value:
            _write(record, entries.add())

    def read(self, wire: Any) -> tuple[Any, ...]:
        return tuple(_read(self.message_type, entry) for entry in getattr(wire, self.name))


@dataclass(frozen=True, slots=True)
class _Numbers:
    """A run of numbers: an array with one axis, or a tuple of fixed length."""

    name: str
    dtype: np.dtype[Any]
    tuple_length: int | None

    def write(self, value: Any, wire: Any) -> None:
        numbers = np.asarray(value)
        if numbers.ndim != 1:
            raise CodecError(f"{self.name} has {numbers.ndim} axes instead of 1")
        setattr(wire, self.name, _to_bytes(numbers, self.dtype))

    def read(self, wire: Any) -> Any:
        numbers = np.frombuffer(getattr(wire, self.name), self.dtype)
        if self.tuple_length is None:
            return numbers
        if len(numbers) != self.tuple_length:
            raise CodecError(f"{self.name} has {len(numbers)} numbers, not {self.tuple_length}")
        return tuple(numbers.tolist())


@dataclass(frozen=True, slots=True)
class _Matrix:
    """An array with two axes, row after row."""

    name: str
    dtype: np.dtype[Any]

    def write(self, value: Any, wire: Any) -> None:
        numbers = np.asarray(value)
        if numbers.ndim != 2:
            raise CodecError(f"{self.name} has {numbers.ndim} axes instead of 2")
        matrix = getattr(wire, self.name)
        matrix.rows, matrix.columns = numbers.shape
        matrix.values = _to_bytes(numbers, self.dtype)

    def read(self, wire: Any) -> Any:
        matrix = getattr(wire, self.name)
        return np.frombuffer(matrix.values, self.dtype).reshape(matrix.rows, matrix.columns)


def _to_bytes(numbers: np.ndarray[Any, Any], dtype: np.dtype[Any]) -> bytes:
    return numbers.astype(dtype, casting="same_kind", copy=False).tobytes()


# ---- the schema, and its wire twin ---------------------------------------------------------------


def schema() -> FileDescriptorProto:
    """Return a copy of pilewatch.proto as a descriptor."""
    return FileDescriptorProto.FromString(pilewatch_pb2.DESCRIPTOR.serialized_pb)


def full_name(message: str) -> str:
    """Name of a message with its package, e.g. pilewatch.StreamGap."""
    return f"{schema().package}.{message}"


def self_description(message: str) -> bytes:
    """Return the serialised FileDescriptorSet that explains one message and what it is made of."""
    file = schema()
    needed = _with_parts(message)
    described = [entry for entry in file.message_type if entry.name in needed]
    del file.message_type[:]
    file.message_type.extend(described)
    return FileDescriptorSet(file=[file]).SerializeToString()


def _with_parts(message: str) -> set[str]:
    parts = (name_of_type(field) for field in schema_of_message(message).field if field.type_name)
    return {message}.union(*map(_with_parts, parts))


def name_of_type(field: FieldDescriptorProto) -> str:
    """Name of the message that a field holds."""
    return field.type_name.rpartition(".")[2]


@cache
def schema_of_message(message: str) -> DescriptorProto:
    """Return the schema's message of that name; KeyError where there is none."""
    return {described.name: described for described in schema().message_type}[message]


def is_run_of_numbers(field: FieldDescriptorProto) -> bool:
    """Whether a field is a packed run of floats or doubles."""
    return field.label == FieldDescriptorProto.LABEL_REPEATED and field.type in NUMBER_TYPES


@cache
def wire_class(message: str) -> Any:
    """Protobuf class of the wire twin's message of that name."""
    twin, pool = _twin()
    return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"{twin.package}.{message}"))


@cache
def _twin() -> tuple[FileDescriptorProto, DescriptorPool]:
    file = schema()
    original = file.package
    file.package = f"{original}.wire"
    file.name = f"{original}/wire.proto"
    for message in file.message_type:
        for field in message.field:
            if field.type_name:
                field.type_name = field.type_name.replace(f".{original}.", f".{file.package}.")
            if is_run_of_numbers(field):
                field.label = FieldDescriptorProto.LABEL_OPTIONAL
                field.type = FieldDescriptorProto.TYPE_BYTES
    pool = DescriptorPool()
    pool.Add(file)
    return file, pool
