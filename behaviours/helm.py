"""Where commands leave: as lines of JSON over UDP. It is never silent: without a fresh decision, the command is to stop."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Callable

from behaviours.types import AXES, Command
from garbi_map.errors import GarbiError
from garbi_map.record.ports import host_and_port

PATIENCE = 0.5  # s without a decision after which the vehicle is told to stop
VALID_FOR = 1.0  # s that a command holds: whoever obeys stops by itself when no other has come by then
LAST_WORDS = 3  # times the last stop is sent, as datagrams get lost
STOP = Command()
Address = tuple[socket.AddressFamily, tuple[str, int]]


class Helm:
    """Sends commands, and watches in a thread of its own that they keep coming.

    address   see `resolved`; None to send nothing
    now       the recorder's clock, ns
    record    is given (stamp ns, command) of everything that is sent, or would be
    trouble   is given what keeps commands from being sent, in words
    """

    def __init__(
        self,
        address: Address | None,
        now: Callable[[], int],
        record: Callable[[int, Command], None],
        trouble: Callable[[str], None],
        patience: float = PATIENCE,
    ) -> None:
        self._now, self._record, self._trouble, self._patience = now, record, trouble, patience
        self._address = address
        self._socket: socket.socket | None = None
        if self._address is not None:
            self._socket = socket.socket(self._address[0], socket.SOCK_DGRAM)
            self._socket.setblocking(False)
        self._lock = threading.Lock()
        self._number = 0
        self._why = "nothing is decided yet"
        self._steered = time.monotonic()
        self._ended = threading.Event()
        self._watch = threading.Thread(target=self._keep_watch, name="garbi helm", daemon=True)
        self.last = "nothing is decided yet: stop"

    def begin(self) -> None:
        """From now on commands go out."""
        self._send(self._now(), STOP, self._why)
        self._watch.start()

    def steer(self, stamp_ns: int, command: Command, why: str) -> None:
        """A fresh decision."""
        self._steered = time.monotonic()
        self._send(stamp_ns, command, why)

    def fail(self, why: str) -> None:
        """There will be no more decisions: stop, again and again, saying why."""
        self._why = why
        self._steered = -self._patience
        self._send(self._now(), STOP, why)

    def end(self) -> None:
        """Stop, for good."""
        self._ended.set()
        self._watch.join()
        for _ in range(LAST_WORDS):
            self._send(self._now(), STOP, "the recording ends")
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _keep_watch(self) -> None:
        while not self._ended.wait(self._patience / 4):
            silence = time.monotonic() - self._steered
            if silence > self._patience:
                why = self._why if self._steered < 0 else f"no decision for {silence:.1f} s"
                self._send(self._now(), STOP, why)

    def _send(self, stamp_ns: int, command: Command, why: str) -> None:
        with self._lock:
            self._number += 1
            self.last = why if command != STOP else f"stop: {why}"
            line = command_line(stamp_ns, self._number, command, why)
            if self._socket is not None and self._address is not None:
                try:
                    self._socket.sendto(line, self._address[1])
                except OSError as error:
                    self._trouble(f"a command could not be sent ({error.strerror})")
        self._record(stamp_ns, command)


def command_line(stamp_ns: int, number: int, command: Command, why: str) -> bytes:
    """The line that is sent: velocities in m/s and rad/s, axes of base_link."""
    axes = {axis: round(float(value), 6) for axis, value in zip(AXES, command.array(), strict=True)}
    stamp = {"stamp_ns": stamp_ns, "number": number}
    return (json.dumps({**stamp, **axes, "valid_for": VALID_FOR, "stop": command == STOP, "why": why}) + "\n").encode()


def resolved(send_to: str) -> Address:
    """The address behind "HOST:PORT". Raises GarbiError."""
    host, port = host_and_port(send_to, send_to)
    try:
        family, _, _, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except OSError as error:
        raise GarbiError(f"{send_to}: no such host") from error
    return family, (str(address[0]), int(address[1]))
