"""Importing this refuses, in one line, a user's folders that hide the project's own packages."""

from importlib.util import find_spec
from pathlib import Path

OWN = {"pipeline": "streams.py", "sensors": "arrays.py"}
"""Top-level packages and a module that each of ours has."""


def require_own_packages() -> None:
    """Check that `pipeline` and `sensors` are ours.

    Raises
    ------
    ImportError
        If a folder or file of that name comes first where Python looks.
    """
    for name, module in OWN.items():
        spec = find_spec(name)
        places = [Path(each) for each in (spec.submodule_search_locations or ())] if spec else []
        if any((place / module).is_file() for place in places):
            continue
        found = places[0] if places else (spec.origin if spec else "nothing")
        raise ImportError(
            f"{found} hides pilewatch's own package {name!r}: give it another name, or start "
            "Python in another folder"
        )


require_own_packages()
