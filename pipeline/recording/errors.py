"""What a person can repair about a recording."""

from sensors.errors import InputError


class RecordingError(InputError):
    """A recording that is missing, foreign, damaged or in the way; the message names the file."""
