"""The schema's messages as the codec fills them, and the schema itself for recordings.

In protobuf a packed `repeated float` and a `bytes` field look the same on the wire. The wire twin
of the schema declares every run of numbers as bytes, so that an array is copied whole (6 µs a
block instead of half a millisecond); what it writes is read by the original, and the other way
round.
"""

from functools import cache
from typing import Any

import numpy as np
from google.protobuf import message_factory
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool

from pipeline.transport.proto import pilewatch_pb2

NUMBER_TYPES: dict[int, np.dtype[Any]] = {
    FieldDescriptorProto.TYPE_FLOAT: np.dtype("<f4"),
    FieldDescriptorProto.TYPE_DOUBLE: np.dtype("<f8"),
}


def schema() -> FileDescriptorProto:
    """A copy of pilewatch.proto as a descriptor."""
    return FileDescriptorProto.FromString(pilewatch_pb2.DESCRIPTOR.serialized_pb)


def full_name(message: str) -> str:
    """Name of a message with its package, e.g. pilewatch.StreamGap."""
    return f"{schema().package}.{message}"


def self_description(message: str) -> bytes:
    """The serialised FileDescriptorSet that explains one message and what it is made of."""
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
    """The schema's message of that name; KeyError where there is none."""
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
