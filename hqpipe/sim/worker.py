"""What a worker process of the batched world does; `hqpipe.sim.__main__` starts it.

The first message is the engine and its setup as JSON. Then each byte on the socket is a command and is answered by
`DONE`, or by `FAILED` and a text. When the parent is gone, the socket ends and so does the worker.
"""

from __future__ import annotations

import json
import socket
import traceback
from dataclasses import asdict

from hqpipe.sim import ENGINES
from hqpipe.sim.engine import Engine, EngineSetup, RobotVariant
from hqpipe.sim.memory import attach
from hqpipe.sim.state import ArraySizes

STEP, RESET = b"s", b"r"
DONE, FAILED = b"d", b"f"
LENGTH_BYTES = 8


def send_text(connection: socket.socket, text: str) -> None:
    data = text.encode()
    connection.sendall(len(data).to_bytes(LENGTH_BYTES, "little") + data)


def receive_text(connection: socket.socket) -> str:
    return _receive(connection, int.from_bytes(_receive(connection, LENGTH_BYTES), "little")).decode()


def _receive(connection: socket.socket, count: int) -> bytes:
    data = bytearray()
    while len(data) < count:
        part = connection.recv(count - len(data))
        if not part:
            raise EOFError("the other end of the socket closed")
        data += part
    return bytes(data)


def describe(engine: str, setup: EngineSetup, sizes: ArraySizes, first: int, last: int) -> str:
    """The first message to a worker that owns the environments `first` … `last` − 1."""
    return json.dumps({"engine": engine, "setup": asdict(setup), "sizes": asdict(sizes), "first": first, "last": last})


def build(message: str, memory: int) -> Engine:
    """Make the engine that `describe` asked for on the memory behind a file descriptor."""
    order = json.loads(message)
    setup = {key: tuple(value) if isinstance(value, list) else value for key, value in order["setup"].items()}
    setup["variants"] = tuple(RobotVariant(**variant) for variant in setup["variants"])
    sizes = ArraySizes(**order["sizes"])
    arrays = sizes.arrays(attach(memory, sizes.nbytes()))
    engine = ENGINES[order["engine"]]
    return engine(EngineSetup(**setup), arrays.rows(order["first"], order["last"]), order["first"])


def serve(connection: socket.socket, memory: int) -> None:
    """Carry out commands until the socket ends."""
    try:
        engine = build(receive_text(connection), memory)
        connection.sendall(DONE)
        actions = {STEP: engine.step, RESET: engine.reset}
        while command := connection.recv(1):
            actions[command]()
            connection.sendall(DONE)
    except Exception:  # not swallowed: the parent raises it, with the traceback
        connection.sendall(FAILED)
        send_text(connection, traceback.format_exc())


def work(descriptor: int, memory: int) -> None:
    """Serve the socket and the memory behind these file descriptors."""
    with socket.socket(fileno=descriptor) as connection:
        try:
            serve(connection, memory)
        except (EOFError, ConnectionError):
            return  # the parent is gone
