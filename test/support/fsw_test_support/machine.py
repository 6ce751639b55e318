"""A machine to test the gateway with, in a thread of the test, and a proxy that cuts or stalls its connections."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from fsw_machine.machine_file import MachineFile
from fsw_plant import PlantConfig, PlantEmulator
from fsw_test_support.machine_server import MachineServer
from fsw_test_support.waiting import PATIENCE_S

_reserved: list[socket.socket] = []


def free_port() -> int:
    """A TCP port that nobody listens on, and on which only a server that is told of it will.

    It stays bound here.
    """
    listener = socket.socket()
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    listener.bind(("127.0.0.1", 0))
    _reserved.append(listener)
    return int(listener.getsockname()[1])


def write_machine_file(path: Path, port: int, text: str, **changes: Any) -> Path:
    """Write a machine file for a port.

    ``changes`` are entries by dotted name (with ``__`` for the dot).
    """
    content = yaml.safe_load(text) | {"endpoint": f"opc.tcp://127.0.0.1:{port}/fsw"}
    for name, value in changes.items():
        *above, last = name.split("__")
        section = content
        for key in above:
            section = section[key]
        section[last] = value
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


class _LoopThread:
    """An event loop in a thread."""

    def __init__(self) -> None:
        self.loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self.loop.run_forever, daemon=True)
        self._thread.start()

    def call(self, coroutine: Any) -> Any:
        """Run a coroutine and return its result."""
        return asyncio.run_coroutine_threadsafe(coroutine, self.loop).result(PATIENCE_S)

    def end(self) -> None:
        self.loop.call_soon_threadsafe(self.loop.stop)
        self._thread.join()
        self.loop.close()


class RunningMachine:
    """The emulated machine of a machine file, running in a thread.

    ``settings`` are parameters of the plant.

    Attributes
    ----------
    server : MachineServer
        To look into; what changes it goes through :meth:`do`.
    """

    def __init__(self, file: Path, server_key: Path | None = None, **settings: Any) -> None:
        self._thread = _LoopThread()
        plant = PlantEmulator(PlantConfig.from_values(settings))
        self.server = MachineServer(MachineFile.load(file), plant, server_key)
        self._thread.call(self.server.open())
        self._running = asyncio.run_coroutine_threadsafe(self.server.run(), self._thread.loop)

    def do(self, act: Callable[[MachineServer], Any]) -> Any:
        """Call a function in the machine's thread."""

        async def call() -> Any:
            return act(self.server)

        return self._thread.call(call())

    def stop(self) -> None:
        """Close the server."""
        self._running.cancel()
        with contextlib.suppress(asyncio.CancelledError, Exception):

            async def ended() -> None:
                while self.server.is_open:
                    await asyncio.sleep(0.01)

            self._thread.call(asyncio.wait_for(ended(), 10.0))
        self._thread.end()


class Proxy:
    """Passes TCP connections on to a port, until it stalls them (nothing arrives, nothing closes) or cuts them."""

    def __init__(self, to_port: int) -> None:
        self._to_port = to_port
        self._thread = _LoopThread()
        self._flows = asyncio.Event()
        self._writers: set[asyncio.StreamWriter] = set()
        self.port: int = self._thread.call(self._open())

    async def _open(self) -> int:
        self._flows.set()
        self._server = await asyncio.start_server(self._accept, "127.0.0.1", 0)
        return int(self._server.sockets[0].getsockname()[1])

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        await self._flows.wait()
        try:
            far_reader, far_writer = await asyncio.open_connection("127.0.0.1", self._to_port)
        except OSError:
            writer.close()
            return
        self._writers |= {writer, far_writer}
        await asyncio.gather(self._pump(reader, far_writer), self._pump(far_reader, writer))
        self._writers -= {writer, far_writer}

    async def _pump(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        with contextlib.suppress(OSError):
            while data := await reader.read(65536):
                await self._flows.wait()
                writer.write(data)
                await writer.drain()
        writer.close()

    def stall(self) -> None:
        """Hold back all data from now on."""
        self._thread.loop.call_soon_threadsafe(self._flows.clear)

    def flow(self) -> None:
        """Pass on what was held back, and what follows."""
        self._thread.loop.call_soon_threadsafe(self._flows.set)

    def cut(self) -> None:
        """Break all connections."""

        def abort() -> None:
            for writer in self._writers:
                writer.transport.abort()

        self._thread.loop.call_soon_threadsafe(abort)

    def stop(self) -> None:
        """Break all connections and take no more."""
        self.cut()
        self._thread.loop.call_soon_threadsafe(self._server.close)
        self._thread.end()
