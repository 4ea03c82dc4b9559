"""What goes wrong on the way from one node to another."""

from sensors.errors import InputError


class TransportError(InputError):
    """An endpoint, a key or a transport's configuration that cannot be used."""


class UnreachableError(TransportError):
    """No session answers at an endpoint; the same command may succeed later."""


class CodecError(ValueError):
    """Bytes that are no message of the expected type, or a message that cannot be written.

    The receiver counts it and goes on: a forged or broken message ends no node.
    """
