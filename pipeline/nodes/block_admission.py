"""Which blocks may enter a running session: a unit's clock runs on, its channels stay.

    block fits the last one taken ──► taken
    it does not ──► held; dropped when the next one fits again
                    five on end that fit each other: the unit has begun anew ──► all are taken

A forged or broken block has no other effect than its count; a unit that has restarted without
saying so, or was away for more than a day, is followed after five blocks. A rate at which a window
would be more than any instrument's is followed by nobody.
"""

from dataclasses import dataclass

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock

STUBBORN = 5  # blocks on end that fit each other and not the session
FARTHEST = 86_400.0  # from one block to the next of a session [s]
MOST_SAMPLES = 10**8  # that may be missing in between: a day at 1 kHz
MOST_VALUES = 5e7  # of a window: ten minutes of eight channels at 10 kHz; in memory 200 MB
CLOCK_STEP = 3600.0  # largest of a unit's clock against its sample count [s]


@dataclass(frozen=True, slots=True)
class Admission:
    """What the gate lets through."""

    blocks: tuple[AccelerationBlock, ...]
    anew: bool = False  # they begin a session of their own, whatever their names


class BlockAdmission:
    """Watches the blocks of one unit."""

    def __init__(self) -> None:
        self.unfit = 0  # blocks that were dropped
        self.complaint = ""  # what was wrong with the last one that was held or dropped
        self._last: AccelerationBlock | None = None
        self._held: list[AccelerationBlock] = []

    def admit(self, block: AccelerationBlock, refusal: str = "") -> Admission:
        """Take a block as it arrives.

        refusal   why the session that runs cannot go on with it; "" where it can
        """
        complaint = refusal or ("" if self._last is None else block_complaint(self._last, block))
        if not complaint:
            self._drop_held()
            self._last = block
            return Admission((block,))
        self.complaint = complaint
        if self._held and not fits(self._held[-1], block):
            self._drop_held()
        self._held.append(block)
        if len(self._held) < STUBBORN:
            return Admission(())
        blocks, self._held, self._last = tuple(self._held), [], block
        return Admission(blocks, anew=True)

    def refuse(self, complaint: str) -> None:
        """Count a block that no session can take, however many like it come."""
        self.unfit += 1
        self.complaint = complaint

    def _drop_held(self) -> None:
        self.unfit += len(self._held)
        self._held.clear()


def fits(last: AccelerationBlock, block: AccelerationBlock) -> bool:
    """Whether one unit may have sent both. A new session may have other channels and rate."""
    return not block_complaint(last, block)


def block_complaint(last: AccelerationBlock, block: AccelerationBlock) -> str:
    """Why one unit cannot have sent both; "" where it may."""
    if block.session != last.session:
        between = abs(block.start_ns - last.end_ns) / NANOSECONDS
        if between <= FARTHEST and between * block.sampling_rate <= MOST_SAMPLES:
            return ""
        return f"another session, {between:g} s from the last one's end"
    rate, n_channels = last.sampling_rate, last.samples.shape[1]
    if (block.sampling_rate, block.samples.shape[1]) != (rate, n_channels):
        return (
            f"{block.samples.shape[1]} channels at {block.sampling_rate:g} Hz in a session of "
            f"{n_channels} at {rate:g} Hz"
        )
    since = (block.first_sample - last.first_sample) / rate
    clock = (block.start_ns - last.start_ns) / NANOSECONDS
    few = max(abs(since), abs(clock)) * rate <= MOST_SAMPLES
    if few and abs(since) <= FARTHEST and abs(clock - since) <= CLOCK_STEP:
        return ""
    return f"{since:g} s after the last one by its samples, {clock:g} s by its clock"


def window_complaint(block: AccelerationBlock, duration: float) -> str:
    """Why a window [s] of such blocks cannot be held; "" where it can."""
    n_values = duration * block.sampling_rate * block.samples.shape[1]
    if n_values <= MOST_VALUES:
        return ""
    return (
        f"a window of {duration:g} s would hold {n_values:.3g} values at {block.sampling_rate:g} "
        f"Hz; at most {MOST_VALUES:g} are held"
    )
