"""An OPC UA server on the loopback interface: asyncua's own, in a thread."""

import asyncio
import threading
from collections.abc import Coroutine, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from asyncua import Server, ua
from asyncua.crypto.permission_rules import User, UserRole
from asyncua.server.user_managers import UserManager

from tests.sensors.feeds.broker import free_port

SPACE = "http://maker.example/tower"
PATIENCE = 30.0  # for what the server is asked to do [s]
BEGIN = datetime(2026, 3, 1, 12, tzinfo=UTC)


class OneUser(UserManager):
    """Lets in everybody without a name, and `operator` with the password `of the tower`."""

    def get_user(
        self, iserver: Any, username: Any = None, password: Any = None, certificate: Any = None
    ) -> User | None:
        known = (username, password) in ((None, None), ("operator", "of the tower"))
        return User(role=UserRole.User) if known else None


async def _others_cancelled() -> None:
    """End the tasks that asyncua's server leaves behind."""
    others = asyncio.all_tasks() - {asyncio.current_task()}
    for task in others:
        task.cancel()
    await asyncio.gather(*others, return_exceptions=True)


class OpcUaServer:
    """A server that is up; its links can be cut.

    Parameters
    ----------
    certificate, key : Path
        Its own: besides an open channel it offers an encrypted one.
    """

    def __init__(self, certificate: Path, key: Path) -> None:
        self.port = free_port()
        self._certificate, self._key = certificate, key
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        self._nodes: dict[str, Any] = {}
        self._server: Any = None
        self._done(self._started())

    def tower(
        self,
        name: str,
        channels: Sequence[str],
        *,
        keeps_history: bool = False,
        initial: float | str = 0.0,
    ) -> None:
        """An object with variables, whose last values are of the time BEGIN."""
        self._done(self._tower_added(name, channels, keeps_history, initial))

    def write(
        self,
        node: str,
        values: Sequence[Any],
        first: int,
        rate: float,
        *,
        stamps: str = "SourceTimestamp",
    ) -> None:
        """Values of a variable, numbered since BEGIN, with one of both time stamps."""
        times = [BEGIN + timedelta(seconds=(first + i) / rate) for i in range(len(values))]
        stamped = [
            ua.DataValue(ua.Variant(value), **{stamps: time})
            for value, time in zip(values, times, strict=True)
        ]
        self._done(self._written(node, stamped))

    def cut(self) -> None:
        """Close every link and accept none."""
        self._done(self._server.bserver.stop())

    def heal(self) -> None:
        """Accept links again."""
        self._done(self._server.bserver.start())

    def close(self) -> None:
        """End."""
        self._done(self._server.stop())
        self._done(_others_cancelled())
        self._loop.call_soon_threadsafe(self._loop.stop)

    def _done(self, work: Coroutine[Any, Any, None]) -> None:
        asyncio.run_coroutine_threadsafe(work, self._loop).result(PATIENCE)

    async def _written(self, node: str, values: list[ua.DataValue]) -> None:
        for value in values:
            await self._nodes[node].write_value(value)

    async def _tower_added(
        self, name: str, channels: Sequence[str], keeps: bool, initial: float | str
    ) -> None:
        index = await self._server.register_namespace(SPACE)
        tower = await self._server.nodes.objects.add_object(index, name)
        for channel in channels:
            path = f"{name}.{channel}"
            node = await tower.add_variable(ua.NodeId(path, index), channel, initial)
            self._nodes[path] = node
            await node.write_value(ua.DataValue(ua.Variant(initial), SourceTimestamp=BEGIN))
            if keeps:
                await self._server.historize_node_data_change(node, period=None, count=0)

    async def _started(self) -> None:
        server = Server(user_manager=OneUser())
        await server.init()
        server.set_endpoint(f"opc.tcp://127.0.0.1:{self.port}/")
        kinds = ua.SecurityPolicyType
        server.set_security_policy([kinds.NoSecurity, kinds.Basic256Sha256_SignAndEncrypt])
        server.set_identity_tokens([ua.AnonymousIdentityToken, ua.UserNameIdentityToken])
        await server.load_certificate(str(self._certificate))
        await server.load_private_key(str(self._key))
        await server.start()
        self._server = server
