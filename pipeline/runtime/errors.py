"""What goes wrong that is nobody's wrong input; those are `sensors.errors.InputError`s."""


class NodeFailed(RuntimeError):  # noqa: N818  # it says what happened
    """A node stopped with an exception; the session cannot give what it promised."""
