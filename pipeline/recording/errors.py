"""What a person can mend about a recording."""

from sensors.errors import InputError


class RecordingError(InputError):
    """A recording that is missing, foreign, damaged or in the way; the message names the file."""
