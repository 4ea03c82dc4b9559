"""Random and mutated messages on every key of a running session, sent past our own encoder.

    example messages (hypothesis) ──► mutated bytes ──► key of the stream ──► a session in threads
                                                                             asked how it does

Every stream gets messages that are whole but mean nothing, whole ones of other streams, damaged
ones and noise, on keys of turbines that exist. They come in rounds, each with its share of every
stream: what a session fetches once (a prior's draws, a model's modes) it has after the first, what
grows with the messages grows from round to round.
"""

import json
import os
import random
import resource
import signal
import subprocess
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import zenoh
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from pipeline.messages import Message, ModalEstimate, Mode
from pipeline.monitoring.status import STATUS_KEY
from pipeline.run.folder import SUMMARY
from pipeline.streams import STREAMS, Stream, key_of
from pipeline.transport.codec import encode
from pipeline.transport.errors import CodecError
from pipeline.transport.zenoh_bus import asked, free_endpoint
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.errors import InputError
from tests.pipeline.example_messages import LAYOUT, block, messages

TURBINES = ("t1", "t2")
NAMES = {"turbine": TURBINES, "unit": ("tower", "lower"), "node": ("recorder", "forger")}
PATIENCE = 90.0  # for what another process does [s]
GOOD = 30  # blocks before and after, at least
MADE_UP = 500  # messages of a type by hypothesis, from which the rest is mutated
UPDATED = 20  # forged estimates that look good; each costs an updating


@dataclass(frozen=True, slots=True)
class FuzzOutcome:
    """What a session made of a flood of nonsense."""

    sent: int
    keys: int
    malformed: int  # dropped by the node that hears everything, as it says
    alive: bool  # every node still says that it runs
    recorded_after: int  # of the good blocks that followed
    memory: tuple[float, ...]  # of the session's process when it is at rest, after each round [MB]
    told_malformed: int  # doubts of that name in the session's summary
    exit_code: int  # when it was told to stop

    @property
    def memory_growth(self) -> float:
        """From the end of the rounds that warm it up to the end of the last [-]."""
        return self.memory[-1] / self.memory[self._warm] - 1.0

    @property
    def growth_of_a_thousand(self) -> float:
        """The same a thousand messages [MB]."""
        sent = self.sent / len(self.memory) * (len(self.memory) - 1 - self._warm)
        return (self.memory[-1] - self.memory[self._warm]) / sent * 1000

    @property
    def _warm(self) -> int:
        """The round after which everything that is fetched once has been: the second of many."""
        return min(1, len(self.memory) - 2)


def fuzz_trial(
    folder: Path, *, examples: int, rate: float, seed: int, rounds: int = 2
) -> FuzzOutcome:
    """So many examples and their mutants on every key, so many messages a second."""
    endpoint = free_endpoint()
    payloads = list(nonsense(examples, seed))
    memory = []
    with running_session(folder / "out", endpoint) as session:
        wait_for_nodes(endpoint)
        with closing(_raw(endpoint)) as sender:
            until_heard(sender, endpoint)
            for one in range(rounds):
                put = paced_put(sender, rate)
                for key, payload in payloads[one::rounds]:
                    put(key, payload)
                settled(endpoint)
                memory.append(resident_bytes(session.pid) / 1e6)
            after = [replace(block(sequence), turbine="t9") for sequence in range(GOOD)]
            put = paced_put(sender, rate)
            for message in after:
                put(key_of(message), encode(message))
            status = settled(endpoint)
        session.send_signal(signal.SIGTERM)
        exit_code = session.wait(PATIENCE)
    counts = {each["key"]: each["messages"] for each in status["streams"]}
    said = own_nodes(status)
    return FuzzOutcome(
        sent=len(payloads),
        keys=len({key for key, _ in payloads}),
        malformed=max(each["malformed"] for each in said.values()),
        alive=all(each["condition"] == "alive" for each in said.values()),
        recorded_after=counts.get(key_of(after[0]), 0),
        memory=tuple(memory),
        told_malformed=told_malformed(folder / "out" / SUMMARY),
        exit_code=exit_code,
    )


@contextmanager
def running_session(out: Path, endpoint: str) -> Iterator["subprocess.Popen[bytes]"]:
    """`pilewatch run --source live` in a process of its own."""
    command = [sys.executable, "-m", "pipeline", "run", "--source", "live", "--no-rrd"]
    command += ["--scenario", "parked"]
    session = subprocess.Popen([*command, "--listen", endpoint, "--out", str(out)])
    try:
        yield session
    finally:
        session.kill()
        session.wait()


def wait_for_nodes(endpoint: str, *, nodes: int = 4) -> None:
    """Until somebody answers for the session and every node has spoken."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        try:
            answers = asked(endpoint, f"{STATUS_KEY}/*")
        except InputError:
            answers = []
        if answers and len(json.loads(answers[0])["nodes"]) >= nodes:
            return
        time.sleep(0.2)
    raise RuntimeError("the session did not become ready")


def settled(endpoint: str) -> dict[str, Any]:
    """What the session says when it has nothing more to take: every node speaks again, and none
    but those that hear the others speak has taken anything since."""
    before: list[int] = []
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        status: dict[str, Any] = json.loads(asked(endpoint, f"{STATUS_KEY}/*")[0])
        nodes = own_nodes(status)
        now = [each["messages"] for each in status["streams"]]
        now += [nodes[name]["received"] for name in ("identification", "updating")]
        if now == before and all(each["silence_s"] < 2.0 for each in nodes.values()):
            return status
        before = now
        time.sleep(1.5)
    raise RuntimeError("the session is still busy")


def own_nodes(status: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The session's own nodes by name, without those that the flood makes up."""
    return {each["node"]: each for each in status["nodes"] if each["turbine"] == "iea15mw"}


def until_heard(sender: "zenoh.Session", endpoint: str) -> None:
    """Good blocks until the session has heard some: what is put before a sender knows of the
    subscribers reaches nobody."""
    deadline = time.monotonic() + PATIENCE
    for sequence in range(1000):
        sender.put(key_of(block(sequence)), encode(block(sequence)))
        status = json.loads(asked(endpoint, f"{STATUS_KEY}/*")[0])
        counts = {each["key"]: each["messages"] for each in status["streams"]}
        if counts.get(key_of(block(0)), 0) >= GOOD or time.monotonic() > deadline:
            return


def told_malformed(summary: Path) -> int:
    """How often a session's summary says that messages were dropped."""
    doubts = json.loads(summary.read_text(encoding="utf-8"))["warnings"]
    return sum(doubt["code"] == "malformed" for doubt in doubts)


def _raw(endpoint: str) -> "zenoh.Session":
    config = zenoh.Config()
    for entry, value in (
        ("mode", "client"),
        ("connect/endpoints", [endpoint]),
        ("scouting/multicast/enabled", False),
    ):
        config.insert_json5(entry, json.dumps(value))
    return zenoh.open(config)


def paced_put(session: "zenoh.Session", rate: float) -> Callable[[str, bytes], None]:
    """Puts that follow each other at a rate [1/s] and are never dropped on the way out."""
    started, count = time.monotonic(), 0

    def put(key: str, payload: bytes) -> None:
        nonlocal count
        time.sleep(max(0.0, started + count / rate - time.monotonic()))
        session.put(key, payload, congestion_control=zenoh.CongestionControl.BLOCK)
        count += 1

    return put


def nonsense(examples: int, seed: int) -> Iterator[tuple[str, bytes]]:
    """(key, payload): for every stream so many payloads, on keys of turbines that exist.

    Whole messages, good ones with one field of another, messages of another stream, damaged ones
    and noise.
    """
    generator = random.Random(seed)
    made = example_messages(min(examples, MADE_UP))
    by_type = {s.message: [m for m in made if type(m) is s.message] for s in STREAMS}
    good = good_messages()
    updated = UPDATED / examples * 4
    for stream in STREAMS:
        own = by_type[stream.message] or made  # of few examples a type may have none
        for _ in range(examples):
            message = with_names(generator.choice(own), generator)
            match generator.randrange(4):
                case 0:
                    pass
                case 1 if stream.message is ModalEstimate and generator.random() > updated:
                    pass
                case 1:
                    one = generator.choice(good.get(stream.message, own))
                    message = with_names(crossed(one, message, generator), generator)
                case 2:
                    message = generator.choice(made)
                case _:
                    yield from _sent(stream, message, generator, damaged=True)
                    continue
            yield from _sent(stream, message, generator, damaged=False)


def _sent(
    stream: Stream, message: Message, generator: random.Random, *, damaged: bool
) -> Iterator[tuple[str, bytes]]:
    try:
        payload = encode(message)
    except CodecError:
        payload = generator.randbytes(40)
    names = {name: generator.choice(chosen) for name, chosen in NAMES.items()}
    own_key = type(message) is stream.message and all(getattr(message, n, "x") for n in NAMES)
    key = key_of(message) if own_key else stream.key.format(**names)
    if all(key.split("/")) and not any(each in key for each in "*$?# "):  # else it is no key
        yield key, mutated(payload, generator) if damaged else payload


def good_messages() -> dict[type, list[Message]]:
    """What a tower that exists says."""
    towers = [replace(block(sequence), turbine=t) for t in TURBINES for sequence in range(GOOD)]
    return {
        AccelerationBlock: list(towers),
        SensorLayout: [LAYOUT],
        ModalEstimate: [estimate_of_tower(turbine) for turbine in TURBINES],
    }


def estimate_of_tower(turbine: str) -> ModalEstimate:
    """A window of the tower's eight channels with two modes, as an identification gives it."""
    n_channels = len(LAYOUT.channels)
    generator = np.random.default_rng(4)
    modes = []
    for frequency in (0.63, 1.83):
        shape = generator.uniform(-1.0, 1.0, n_channels)
        shape /= shape[np.argmax(np.abs(shape))]
        factor = 1e-3 * generator.standard_normal((2 + n_channels, 6))
        std, damping_std = np.linalg.norm(factor[:2], axis=1)
        modes.append(Mode("m1", frequency, float(std), 0.007, float(damping_std), shape, factor, 6))
    names, start_ns = LAYOUT.channel_names, block(0).start_ns
    end_ns = start_ns + 600 * NANOSECONDS
    return ModalEstimate(turbine, 0, start_ns, end_ns, LAYOUT.layout_id, names, tuple(modes))


def crossed(good: Message, strange: Message, generator: random.Random) -> Message:
    """A good message with one field of a strange one, of another type it may be."""
    name = generator.choice([f.name for f in fields(good) if hasattr(strange, f.name)])
    return replace(good, **{name: getattr(strange, name)})


def example_messages(count: int) -> list[Message]:
    """Messages of every type, as hypothesis makes them up."""
    made: list[Message] = []

    @settings(
        max_examples=3 * count + 300,
        database=None,
        derandomize=True,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(st.one_of(messages))
    def take(message: Message) -> None:
        made.append(message)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        take()
    return made


def with_names(message: Message, generator: random.Random) -> Message:
    """The message as one of a turbine, unit and node that exist."""
    own = {field.name for field in fields(message)}
    chosen = {name: generator.choice(all_) for name, all_ in NAMES.items() if name in own}
    return replace(message, **chosen)


def mutated(payload: bytes, generator: random.Random) -> bytes:
    """The bytes damaged in one of several ways."""
    data = bytearray(payload or b"\0")
    at = generator.randrange(len(data))
    match generator.randrange(6):
        case 0:
            for _ in range(generator.randint(1, 8)):
                data[generator.randrange(len(data))] ^= generator.randrange(1, 256)
        case 1:
            del data[at:]
        case 2:
            del data[at : at + generator.randint(1, 16)]
        case 3:
            data[at:at] = data[: generator.randint(1, 64)]
        case 4:
            data[at : at + 10] = b"\xff" * 9 + b"\x01"  # the largest number there is
        case _:
            data = bytearray(generator.randbytes(generator.randint(0, 200)))
    return bytes(data)


def resident_bytes(pid: int) -> int:
    """Memory of a process that is not swapped out."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * resource.getpagesize()


def fuzz_decoder(seconds: int) -> None:
    """Coverage-guided: atheris on the decoder, for so long; raises what it finds."""
    subprocess.run(
        [sys.executable, "-m", "tests.benchmarks._fuzz_decoder", f"-max_total_time={seconds}"],
        check=True,
        env=os.environ | {"PYTHONWARNINGS": "ignore"},
    )
