"""Which blocks of a unit are used: its samples go on, its channels stay, whatever its clock says.

    block follows the last one taken ──► taken
    it does not ──► held; refused when the next one follows again
                    five on end that follow each other: the unit goes on with them

A forged, stray or broken block has no other effect than its count under the reason's code. A unit
that starts again, under a new session's name or the same, is followed after five blocks, or at once
where the end of its session was announced. Its starts under one session's name are its boots.

A boot that goes on although another one has started since is another device under the same name:
the first one's blocks are used, the other's are refused while the first one sends. What is beyond
[limits] is refused too, so that no unit costs the others' windows.
"""

from collections import Counter
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from typing import Any, NamedTuple

import numpy as np

from pipeline.messages import QualityWarning
from pipeline.oma.windows.unit_clock import CLOCK_ERROR
from pipeline.oma.windows.windowing import Beginning
from sensors.acquisition.blocks import (
    CLOCK_STEP,
    AccelerationBlock,
    BlockMark,
    Sampled,
    time_apart,
)
from sensors.bounded_dict import BoundedDict
from sensors.errors import InputError
from sensors.settings import NO_KEY

STUBBORN = 5  # blocks on end that follow each other and not the last one taken
MOST_CANDIDATES = 4  # sessions whose blocks are held
RETURNING = 1000  # the same, of a boot that is over and whose stamps are of the past
SECOND_ALONE = 300  # the same, of a second device that sends under the first one's name
MOST_SKIPPED = 10**8  # that may be missing in between: a day at 1 kHz
REMEMBERED_CONTENTS = 600  # blocks whose samples are recognised
FEWEST_RECOGNISABLE = 10  # of a block that is not like another by chance
MOST_SESSION_NAMES = 64  # names of sessions whose boots are remembered
MOST_BOOTS_OVER = 8  # whose last blocks are remembered

# Codes of refusals, as they are counted in a NodeStatus.
UNFIT = "does-not-follow"
OTHER_SESSION = "other-session"
CONFLICT = "conflicting-content"
REPEATED = "repeated-samples"
LAYOUT = "not-its-layout"
UNITS = "cannot-be-joined"
NO_LAYOUT = "no-layout"
SECOND = "second-device"
TOO_LARGE = "window-too-large"
TOO_MANY_CHANNELS = "too-many-channels"
TOO_FAST = "sampled-too-fast"
TOO_LARGE_BLOCK = "block-too-large"


class Boot(NamedTuple):
    """A start of a unit."""

    session: str
    number: int
    """Starts under that session's name before it."""


class LimitError(InputError):
    """A limit that cannot be right; the message names it."""


@dataclass(frozen=True, slots=True)
class LimitSettings:
    """Section [limits]: what is beyond them is recorded, counted and not identified."""

    channels: int = 100
    """Largest number of channels of a unit; the time for a window grows with its square."""
    sampling_rate: float = field(default=10_000.0, metadata=NO_KEY)
    """Of a unit [Hz]: faster is no vibration of a tower."""
    block_megabytes: float = 5.0
    """Largest size of a block's samples [10⁶ bytes]."""
    cpu_seconds: float = 120.0
    """CPU time of a run for one window [s]; a window that needs more is rejected."""
    window_values: float = 1e7
    """Largest number of values of a window, samples × channels; each takes some 40 bytes while
    it is identified. The default is sixteen channels at 1 kHz for ten minutes.
    """
    units: int = 16
    """Largest number of units of a turbine."""
    turbines: int = 300
    """Largest number of turbines; each takes 3 MB of the updating."""

    def __post_init__(self) -> None:
        for each in fields(self):
            value = getattr(self, each.name)
            if not value > 0:
                raise LimitError(f"[limits] {each.name} is {value:g}; it must be > 0")


DEFAULT_LIMITS = LimitSettings()


def window_refusal(
    block: AccelerationBlock, duration: float, limits: LimitSettings = DEFAULT_LIMITS
) -> QualityWarning | None:
    """Return why a window of such blocks cannot be identified; None where it can.

    Parameters
    ----------
    duration : float
        Of a window [s].
    """
    n_channels, rate = block.samples.shape[1], block.sampling_rate
    if n_channels > limits.channels:
        return QualityWarning(
            TOO_MANY_CHANNELS,
            f"{n_channels} channels; a unit has at most {limits.channels} that are identified "
            "([limits] channels)",
        )
    n_values = duration * rate * n_channels
    if n_values > limits.window_values:
        return QualityWarning(
            TOO_LARGE,
            f"a window of {duration:g} s would hold {n_values:.3g} values at {rate:g} Hz; at most "
            f"{limits.window_values:g} are held ([limits] window_values)",
        )
    if rate > limits.sampling_rate:
        return QualityWarning(
            TOO_FAST, f"{rate:g} Hz; at most {limits.sampling_rate:g} Hz are identified"
        )
    if block.samples.nbytes > 1e6 * limits.block_megabytes:
        return QualityWarning(
            TOO_LARGE_BLOCK,
            f"a block of {1e-6 * block.samples.nbytes:.1f} MB; at most {limits.block_megabytes:g} "
            "MB are identified",
        )
    return None


@dataclass(frozen=True, slots=True)
class Admission:
    """What may be used now."""

    blocks: tuple[AccelerationBlock, ...] = ()
    """In the order of arrival."""
    begins: Beginning | None = None
    """Where a boot that they begin is expected to begin: what was running before is over."""


class BlockAdmission:
    """Watches the blocks of one unit."""

    def __init__(self) -> None:
        self.refused: Counter[str] = Counter()  # blocks, by the reason's code
        self.last_refusal = ""  # what was wrong with the last one that was held or refused
        self.conflicts: list[int] = []  # first samples that came with two contents in this boot
        self.sequence_jumps = 0  # block numbers that jumped where samples did not
        self._boots = BoundedDict[str, int](MOST_SESSION_NAMES)  # by session's name
        self._over: dict[Boot, BlockMark] = {}  # last block taken of boots before this one
        self._second: set[Boot] = set()  # of them, those of a second device
        self._began_ns = 0  # stamp with which the present boot began
        self._last: BlockMark | None = None
        self._number = 0  # starts under the present session's name before this one
        self._ended = False  # the end of the present session was announced
        self._held: dict[str, list[AccelerationBlock]] = {}  # by session, in their order
        self._refused_lately = BoundedDict[str, list[AccelerationBlock]](MOST_CANDIDATES)
        self._left_out: list[AccelerationBlock] = []  # of these, where a boot begins
        self._on_end: Counter[str] = Counter()  # blocks of a session that follow each other
        self._contents: dict[int, int] = {}  # first sample → hash of samples, of this boot
        self._samples: dict[int, int] = {}  # hash of samples → first sample

    @property
    def session(self) -> str | None:
        """Name of the present session; None before the first block."""
        return None if self._last is None else self._last.session

    @property
    def boot(self) -> Boot:
        """The present one."""
        return Boot(self.session or "", self._number)

    def admit(self, block: AccelerationBlock, refusal: QualityWarning | None = None) -> Admission:
        """Take a block as it arrives.

        Parameters
        ----------
        refusal : QualityWarning, optional
            Why what runs cannot go on with the block; None where it can.
        """
        if self._last is None:
            return self._begin((block,))
        if self._ended and block.session != self.session and not self._is_over(block.session):
            return self._begin((*self._let_in(block.session), block))
        against = refusal or self._against(block)
        if against is None:
            chain = self._with_held(block)
            self._drop_held()
            taken = [self._taken(each).blocks for each in chain]
            return Admission(tuple(each for blocks in taken for each in blocks))
        self.last_refusal = against.text
        held = self._held.pop(block.session, [])
        if held and refusal_of(BlockMark.of(held[-1]), block) is not None:
            self._refuse_all(held)
            held = []
        self._on_end[block.session] = self._on_end[block.session] + 1 if held else 1
        held.append(block)
        self._held[block.session] = held  # the last is the one held last
        if self._on_end[block.session] < self._needed(held):
            self._make_room(held)
            return Admission()
        blocks = self._let_in(block.session)
        goes_on = self._boot_over(blocks[0]) is None and self._goes_on(blocks[0])
        return self._continued(blocks) if goes_on else self._begin(blocks)

    def note_end(self, session: str) -> Admission:
        """Take note that a session's end was announced; its blocks that are held are let in."""
        if session == self.session:
            self._ended = True
        if session not in self._held or session == self.session or self._is_over(session):
            return Admission()
        return self._begin(self._let_in(session))

    def refuse(self, refusal: QualityWarning) -> None:
        """Count a block that cannot be used, however many like it come."""
        self.refused[refusal.code] += 1
        self.last_refusal = refusal.text

    def state(self) -> dict[str, Any]:
        """Return what a restart needs, as JSON can say it."""
        return {
            "boot": self._number,
            "boots": dict(self._boots),
            "last": None if self._last is None else asdict(self._last),
            "began_ns": self._began_ns,
            "over": [[*key, asdict(mark), key in self._second] for key, mark in self._over.items()],
        }

    def resume(self, state: Mapping[str, Any]) -> None:
        """Go on from what `state` gave."""
        self._number = int(state["boot"])
        self._boots.update(state["boots"])
        self._last = None if state["last"] is None else BlockMark(**state["last"])
        self._began_ns = int(state.get("began_ns", 0))
        for session, boot, mark, second in state.get("over", ()):
            self._over[Boot(session, boot)] = BlockMark(**mark)
            if second:
                self._second.add(Boot(session, boot))

    def begin_after(self, mark: BlockMark) -> None:
        """Expect the block with that mark, or one that follows it."""
        self._last = mark

    def _with_held(self, block: AccelerationBlock) -> tuple[AccelerationBlock, ...]:
        """A block that follows, with those of its session that are held and lie beside it."""
        held = self._held.pop(block.session, [])
        if held and held[0].first_sample == block.next_sample:
            return (block, *held)
        beside = bool(held) and held[-1].next_sample == block.first_sample
        if beside and self._goes_on(held[0]):
            return (*held, block)  # a clock was set, by as much as stamps may be off just now
        self._refuse_all(held)
        return (block,)

    def _against(self, block: AccelerationBlock) -> QualityWarning | None:
        assert self._last is not None
        against = refusal_of(self._last, block)
        if against is None and self._over and not _tight(self._last, block):
            over = self._boot_over(block)
            if over is not None and self._over[over].next_sample == block.first_sample:
                return QualityWarning(UNFIT, "its number and stamp follow those of another boot")
        held = self._held.get(block.session)
        if against is not None or not held:
            return against
        if _tight(held[-1], block) and not _tight(self._last, block):
            return QualityWarning(UNFIT, "its stamps go on from those of blocks that do not follow")
        return None

    def _taken(self, block: AccelerationBlock) -> Admission:
        assert self._last is not None
        against = self._content_refusal(block)
        if against is not None:
            self.refuse(against)
            return Admission()
        if block.first_sample > self._last.first_sample:
            contiguous = block.first_sample == self._last.next_sample
            self.sequence_jumps += contiguous and block.sequence != self._last.sequence + 1
            self._last = BlockMark.of(block)
        return Admission((block,))

    def _content_refusal(self, block: AccelerationBlock) -> QualityWarning | None:
        """Refuse a block whose number came with other samples, or the other way round."""
        content = hash(block.samples.tobytes())
        known = self._contents.get(block.first_sample)
        if known is not None:
            if known == content:
                return None  # the same once more
            self.conflicts = [*self.conflicts, block.first_sample][-REMEMBERED_CONTENTS:]
            return QualityWarning(
                CONFLICT,
                f"sample {block.first_sample} came twice with different values: two devices send "
                "under one name",
            )
        alive = len(block.samples) >= FEWEST_RECOGNISABLE and np.ptp(block.samples, axis=0).all()
        if content in self._samples and alive:
            return QualityWarning(
                REPEATED,
                f"its values are those of sample {self._samples[content]} bit for bit, under "
                f"number {block.first_sample}",
            )
        self._contents[block.first_sample] = content
        self._samples[content] = block.first_sample
        if len(self._contents) > REMEMBERED_CONTENTS:
            oldest = self._contents.pop(next(iter(self._contents)))
            self._samples.pop(oldest, None)
        return None

    def _needed(self, held: list[AccelerationBlock]) -> int:
        """Blocks on end that it takes."""
        assert self._last is not None
        over, latest = self._boot_over(held[-1]), held[-1].start_ns
        if over in self._second:
            return STUBBORN if self._ended else SECOND_ALONE
        if over is not None:  # sent again after it was over, or never over
            return RETURNING if latest <= self._began_ns else STUBBORN
        of_the_past = self._is_over(held[-1].session) and latest < self._last.end_ns
        return RETURNING if of_the_past and held[0].sequence > 0 else STUBBORN

    def _boot_over(self, block: AccelerationBlock) -> Boot | None:
        """Return which boot before this one a block follows, by number and by stamp."""
        following = [
            (abs(since - clock), key)
            for key, mark in self._over.items()
            if key[0] == block.session and block.first_sample >= mark.next_sample
            if _tight(mark, block)
            for since, clock in [time_apart(mark, block)]
        ]
        return min(following)[1] if following else None

    def _let_in(self, session: str) -> tuple[AccelerationBlock, ...]:
        """Return the blocks of a session that are held; those of others are refused."""
        found = sorted(self._held.pop(session, ()), key=lambda block: block.first_sample)
        self._drop_held()
        return (*self._taken_back(session, found), *found)

    def _taken_back(
        self, session: str, found: list[AccelerationBlock]
    ) -> tuple[AccelerationBlock, ...]:
        """Blocks of a session that were refused a moment ago, and that its first ones follow."""
        refused = self._refused_lately.pop(session, [])
        chain: list[AccelerationBlock] = []
        for block in sorted(refused, key=lambda each: -each.first_sample):
            following = (chain or found)[0] if found else None
            if following is None or block.next_sample != following.first_sample:
                break
            chain.insert(0, block)
        self._left_out = [each for each in refused if not any(each is kept for kept in chain)]
        self.refused.subtract(self._code_of(block) for block in chain)
        self.refused += Counter()  # codes without a block go
        return tuple(chain)

    def _make_room(self, held: list[AccelerationBlock]) -> None:
        if len(held) > STUBBORN:
            self._refuse(held.pop(0))
        if len(self._held) > MOST_CANDIDATES:
            self._refuse_all(self._held.pop(next(iter(self._held))))

    def _is_over(self, session: str) -> bool:
        """Whether another session has followed a session."""
        return session != self.session and session in self._boots

    def _goes_on(self, block: AccelerationBlock) -> bool:
        """Whether a block is of the present boot, after a gap in which the clock was set."""
        last = self._last
        assert last is not None
        if block.session != last.session or block.first_sample < last.next_sample:
            return False
        if (block.sampling_rate, block.samples.shape[1]) != (last.sampling_rate, last.n_channels):
            return False
        blocks = block.sequence - last.sequence
        counted = (block.first_sample - last.first_sample) / last.n_samples
        few = block.first_sample - last.first_sample <= MOST_SKIPPED
        return few and blocks > 0 and abs(counted - blocks) <= max(2.0, 0.5 * blocks)

    def _continued(self, blocks: tuple[AccelerationBlock, ...]) -> Admission:
        self._last = BlockMark.of(blocks[-1])
        return Admission(blocks)

    def _begin(self, blocks: tuple[AccelerationBlock, ...]) -> Admission:
        begins = self._beginning(blocks)
        self._began_ns = blocks[0].start_ns
        self._last, self._ended = BlockMark.of(blocks[-1]), False
        self._contents.clear()
        self._samples.clear()
        self.conflicts = []
        for block in blocks:
            self._content_refusal(block)
        return Admission(blocks, begins)

    def _beginning(self, blocks: tuple[AccelerationBlock, ...]) -> Beginning:
        """Count a boot, or take up the one before that goes on; where it is expected to begin."""
        name, last = blocks[0].session, self._last
        over = self._boot_over(blocks[0])
        if last is not None:
            self._over[self.boot] = last
            if over is not None and blocks[-1].start_ns > self._began_ns:
                self._second.add(self.boot)
        if over is not None:
            mark = self._over.pop(over)
            self._second.discard(over)
            self._number = over.number
            return Beginning(mark.next_sample, mark.sequence + 1)
        for oldest in list(self._over)[:-MOST_BOOTS_OVER]:
            del self._over[oldest]
            self._second.discard(oldest)
        self._number = self._boots.pop(name, -1) + 1
        self._boots[name] = self._number
        if last is None or last.session != name or blocks[0].sequence <= last.sequence:
            return Beginning(refused=self._first_refused(blocks[0]))
        # another rate or shape within the numbers of one boot
        missing = (blocks[0].sequence - last.sequence - 1) * len(blocks[0].samples)
        return Beginning(max(0, blocks[0].first_sample - missing), last.sequence + 1)

    def _first_refused(self, block: AccelerationBlock) -> int:
        """Return how many blocks from a boot's first on were refused before the one it begins with:
        a reboot, a cut a moment later, and a clock that was set meanwhile."""
        count = 0
        for each in sorted(self._left_out, key=lambda left: left.start_ns):
            of_it = each.sequence == count < block.sequence and each.start_ns < block.start_ns
            count += of_it
        return count

    def _refuse(self, block: AccelerationBlock) -> None:
        code = self._code_of(block)
        self.refused[code] += 1
        if code == SECOND:
            self.last_refusal = f"two devices send under one name, both as {block.session!r}"

    def _code_of(self, block: AccelerationBlock) -> str:
        """Code of why a block that was held is refused."""
        if self._boot_over(block) in self._second:
            return SECOND
        other = self._last is not None and block.session != self._last.session
        return OTHER_SESSION if other else UNFIT

    def _refuse_all(self, blocks: list[AccelerationBlock]) -> None:
        for block in blocks:
            self._refuse(block)
        if blocks:
            before = self._refused_lately.pop(blocks[-1].session, [])
            self._refused_lately[blocks[-1].session] = [*before, *blocks][-STUBBORN:]

    def _drop_held(self) -> None:
        for blocks in self._held.values():
            self._refuse_all(blocks)
        self._held.clear()
        self._on_end.clear()


def refusal_of(last: BlockMark, block: AccelerationBlock) -> QualityWarning | None:
    """Return why one boot of one unit cannot have sent both; None where it may.

    A block that follows without a gap may have any stamp: clocks are set.
    """
    if block.session != last.session:
        return QualityWarning(OTHER_SESSION, f"session {block.session!r} within {last.session!r}")
    if (block.sampling_rate, block.samples.shape[1]) != (last.sampling_rate, last.n_channels):
        return QualityWarning(
            UNFIT,
            f"{block.samples.shape[1]} channels at {block.sampling_rate:g} Hz in a session of "
            f"{last.n_channels} at {last.sampling_rate:g} Hz",
        )
    if block.first_sample == last.next_sample or _tight(last, block):
        return None
    since, clock = time_apart(last, block)
    return QualityWarning(
        UNFIT, f"{since:g} s after the last one by its samples, {clock:g} s by its clock"
    )


def _tight(last: Sampled, block: AccelerationBlock) -> bool:
    """Whether stamps and samples agree on the time between two blocks."""
    since, clock = time_apart(last, block)
    few = max(abs(since), abs(clock)) * last.sampling_rate <= MOST_SKIPPED
    return few and abs(clock - since) <= CLOCK_STEP + CLOCK_ERROR * abs(since)
