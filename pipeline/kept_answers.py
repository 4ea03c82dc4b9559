"""An identification that runs without the session's recording keeps its own latest answers.

    tracks/identification-t1.checkpoint    one small file a turbine, new after each window
                     the windows in which a mode may still be looked for, without covariances;
                     the last of them whole

Started again on the machine where it was, it goes on after the last window that it answered, and
modes keep their names: two modes of one name would be taken for one by whoever reads all windows.
The samples of the open window come from the publishers' caches. The layout of the files is that of
`pipeline.checkpoints`.
"""

import logging
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from pipeline.checkpoints import CheckpointFolder, NodeCheckpoint
from pipeline.messages import (
    Message,
    ModalEstimate,
    Warning,  # noqa: A004  # the field's word
    WindowRejected,
)
from pipeline.nodes.coat import Coat
from pipeline.oma.tracking import DIES_AFTER
from pipeline.resumption import ResumedIdentification, WindowAnswer
from sensors.acquisition.blocks import AccelerationBlock

logger = logging.getLogger(__name__)

FOLDER = "tracks"  # inside a session's folder
MOST_WINDOWS = DIES_AFTER + 1  # that are kept of a turbine
MOST_TURBINES = 1000  # that are kept in memory; of strangers' there may be any number


class KeptIdentification(Coat[ResumedIdentification]):
    """An identification whose latest answers lie in a folder, from which it goes on.

    node     that has taken up nothing of the turbines that it is to take up from the folder
    folder   which is made when it is first needed

    A disk that is full costs the names of modes after a restart; `warnings` says so. Handling a
    block raises CheckpointError for a file of its turbine that is none.
    """

    name = "identification"
    inputs: tuple[type, ...] = ResumedIdentification.inputs

    def __init__(self, node: ResumedIdentification, folder: Path) -> None:
        super().__init__(node)
        self._folder = CheckpointFolder(folder, "identification")
        self._kept: dict[str, tuple[WindowAnswer, ...]] = {}  # by turbine, windows in order
        self._doubts: tuple[Warning, ...] = ()

    def handle(self, message: Message) -> Iterator[Message]:
        if isinstance(message, AccelerationBlock) and message.turbine not in self._kept:
            self._recollect(message.turbine)
        for answer in self._inner.handle(message):
            yield answer
            if isinstance(answer, ModalEstimate | WindowRejected):
                self._keep(answer)

    def _recollect(self, turbine: str) -> None:
        found = self._folder.read(turbine)
        answers = () if found is None else found.answers
        kept = tuple(e for e in answers if isinstance(e, ModalEstimate | WindowRejected))
        self._inner.remember(turbine, kept, updated_ns=max([0, *(e.end_ns for e in kept[:-1])]))
        self._kept[turbine] = kept
        if len(self._kept) > MOST_TURBINES:
            del self._kept[next(iter(self._kept))]

    def _keep(self, answer: WindowAnswer) -> None:
        before = (
            _without_covariances(each)
            for each in self._kept.get(answer.turbine, ())
            if each.start_ns != answer.start_ns
        )
        kept = (*before, answer)[-MOST_WINDOWS:]
        self._kept[answer.turbine] = kept
        try:
            self._folder.write(NodeCheckpoint(answer.turbine, answer.end_ns, b"", kept))
        except OSError as error:
            path, reason = self._folder.file_of(answer.turbine), error.strerror or error
            text = f"{path} could not be written ({reason}): modes lose their names by a restart"
            if not self._doubts:
                logger.error(text)
            self._doubts = (Warning("checkpoint-not-written", text),)
        else:
            self._doubts = ()

    @property
    def warnings(self) -> tuple[Warning, ...]:
        """The node's own, and that the disk is full."""
        return (*self._inner.warnings, *self._doubts)


def _without_covariances(answer: WindowAnswer) -> WindowAnswer:
    """An estimate as far as its modes' names need it: a hundredth of its size."""
    if isinstance(answer, WindowRejected):
        return answer
    modes = tuple(
        replace(mode, covariance_factor=mode.covariance_factor[:, :0], n_block_columns=0)
        for mode in answer.modes
    )
    return replace(answer, modes=modes)
