"""A real MQTT broker on the loopback interface: mosquitto, where it is installed."""

import getpass
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from paho.mqtt import client as paho

PATIENCE = 20.0  # for the broker and for whoever publishes [s]


def mosquitto() -> str | None:
    """Where the program lies; None where it is not installed."""
    return shutil.which("mosquitto") or shutil.which("mosquitto", path="/usr/sbin:/usr/local/sbin")


def free_port() -> int:
    """A port that nobody listens on at this moment."""
    with closing(socket.socket()) as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


class Broker:
    """Starts, dies and comes back at the same port.

    folder   for its configuration
    lines    that are added to it
    """

    def __init__(self, folder: Path, *lines: str) -> None:
        program = mosquitto()
        assert program is not None
        self.port = free_port()
        self._configuration = folder / "mosquitto.conf"
        open_to_all = [] if any("allow_anonymous" in line for line in lines) else ["true"]
        self._configuration.write_text(
            "\n".join(
                [
                    f"listener {self.port} 127.0.0.1",
                    f"user {getpass.getuser()}",  # root gives its rights up for another otherwise
                    "max_queued_messages 100000",
                    "max_inflight_messages 0",
                    *(f"allow_anonymous {each}" for each in open_to_all),
                    *lines,
                ]
            )
            + "\n"
        )
        self._command = [program, "-c", str(self._configuration)]
        self._process: subprocess.Popen[bytes] | None = None

    def start(self) -> None:
        """Come up; returns when it listens."""
        self._process = subprocess.Popen(
            self._command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        deadline = time.monotonic() + PATIENCE
        while time.monotonic() < deadline:
            with closing(socket.socket()) as probe:
                if probe.connect_ex(("127.0.0.1", self.port)) == 0:
                    return
            time.sleep(0.01)
        raise TimeoutError("mosquitto does not listen")

    def kill(self) -> None:
        """Die without a word."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def stop(self) -> None:
        """End as it is told to: what it keeps is written to its folder, if it keeps anything."""
        if self._process is not None:
            self._process.terminate()
            self._process.wait()
            self._process = None


@contextmanager
def broker(folder: Path, *lines: str) -> Iterator[Broker]:
    """A broker that runs."""
    made = Broker(folder, *lines)
    made.start()
    try:
        yield made
    finally:
        made.kill()


@contextmanager
def publisher(port: int) -> Iterator["Publisher"]:
    """Somebody who publishes."""
    made = Publisher(port)
    try:
        yield made
    finally:
        made.close()


class Publisher:
    """Publishes; what is not acknowledged yet goes out again when the broker is back."""

    def __init__(self, port: int) -> None:
        self._client: Any = paho.Client(paho.CallbackAPIVersion.VERSION2)
        self._client.max_inflight_messages_set(1000)
        self._client.reconnect_delay_set(1, 1)
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()

    def publish(
        self, topic: str, payload: bytes | str, *, qos: int = 1, retain: bool = False
    ) -> None:
        """Hand over; see `settled`."""
        self._last = self._client.publish(topic, payload, qos=qos, retain=retain)

    def settled(self) -> None:
        """Return when the broker has the last one."""
        self._last.wait_for_publish(PATIENCE)

    def close(self) -> None:
        """Leave."""
        self._client.disconnect()
        self._client.loop_stop()
