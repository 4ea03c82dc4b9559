"""Failures that wrong input does not cause; wrong input is a `sensors.errors.InputError`."""


class NodeFailed(RuntimeError):  # noqa: N818  # the name states what happened
    """A node stopped with an exception; the session cannot give what it promised."""
