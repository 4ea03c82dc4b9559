"""Windows of the same samples are identified once for all tests of a module.

For tests of what becomes of a window (its fate, its order, its channels), which send the same
samples again under other stamps, in another order or after a restart. What the identification
itself returns is tested elsewhere, without this.
"""

from collections.abc import Iterator
from functools import partial
from hashlib import blake2b
from typing import Any

import numpy as np
import pytest

from pipeline.nodes import window_identification
from pipeline.oma import streaming
from pipeline.oma.identification import Identification, identify


@pytest.fixture(scope="module")
def identified_once() -> Iterator[None]:
    """For `pytestmark = pytest.mark.usefixtures("identified_once")`."""
    known: dict[tuple[object, ...], Identification] = {}
    with pytest.MonkeyPatch.context() as patch:
        for module in (window_identification, streaming):
            patch.setattr(module, "identify", partial(_remembered, known))
        yield


def _remembered(
    known: dict[tuple[object, ...], Identification], samples: Any, *others: Any, **named: Any
) -> Identification:
    """The answer to these arguments, computed the first time."""
    key = tuple(map(_content, (samples, *others, *sorted(named.items()))))
    if key not in known:
        known[key] = identify(samples, *others, **named)
    return known[key]


def _content(argument: Any) -> object:
    if isinstance(argument, np.ndarray):
        return argument.shape, argument.dtype.str, blake2b(argument.tobytes()).digest()
    if isinstance(argument, list | tuple):
        return tuple(map(_content, argument))
    return argument
