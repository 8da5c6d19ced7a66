"""Where sensors' lines come in: a serial port, or UDP."""

from __future__ import annotations

import errno
import os
import socket
from typing import Any, Protocol

from garbi_map.errors import GarbiError

BAUD = 115_200
PATIENCE = 0.1  # s, after which `read` comes back empty
LARGEST = 4096  # bytes of a datagram; a larger one is refused
SENDER_KEPT = 3.0  # s of silence after which another sender is listened to


class PortTrouble(Exception):
    """The port cannot be opened, or is gone; a few words."""


class Port(Protocol):
    """A source of bytes.

    name  what the user called it;  wire: seconds that a byte takes;  hint: what to look at when nothing can be read
    """

    name: str
    wire: float
    hint: str

    def open(self) -> None:
        """Raises PortTrouble."""

    def read(self) -> bytes:
        """What has come in, b"" where nothing came within PATIENCE. Raises PortTrouble."""

    def close(self) -> None:
        """It may be opened again."""


def port_of(text: str) -> Port:
    """`/dev/ttyUSB0`, `/dev/ttyUSB0@57600`, `udp://:5005`, `udp://127.0.0.1:5005`. Raises GarbiError on anything else."""
    if text.startswith("udp://"):
        host, port = host_and_port(text.removeprefix("udp://"), text)
        return UdpPort(text, host, port)
    path, at, baud = text.rpartition("@")
    if not at:
        return SerialPort(text, text, BAUD)
    if not path or not baud.isdecimal() or not 50 <= int(baud) <= 10_000_000:
        raise GarbiError(f"{text}: not a baud rate behind the @; say /dev/ttyUSB0@115200")
    return SerialPort(text, path, int(baud))


def host_and_port(text: str, said: str) -> tuple[str, int]:
    """ "host:port"; raises GarbiError."""
    host, colon, port = text.rpartition(":")
    if not colon or not port.isdecimal() or not 0 < int(port) < 65536:
        raise GarbiError(f"{said}: not an address; say HOST:PORT with a port from 1 to 65535")
    return host.strip("[]"), int(port)


class SerialPort:
    """A serial port, 8N1."""

    def __init__(self, name: str, path: str, baud: int) -> None:
        self.name, self._path, self._baud = name, path, baud
        self.wire = 10.0 / baud
        self.hint = f"is the baud rate ({baud}) right?"
        self._port: Any = None

    def open(self) -> None:
        """See `Port`."""
        import serial

        try:
            self._port = serial.Serial(self._path, self._baud, timeout=PATIENCE, exclusive=True)
        except (OSError, ValueError) as error:
            raise PortTrouble(_short(error, "cannot be opened")) from error

    def read(self) -> bytes:
        """See `Port`."""
        port = self._port
        try:
            return bytes(port.read(max(port.in_waiting, 1)))
        except (OSError, TypeError, AttributeError) as error:  # pyserial's own when the port is closed under it
            raise PortTrouble("is gone") from error

    def close(self) -> None:
        """See `Port`."""
        if self._port is not None:
            self._port.close()
            self._port = None


class UdpPort:
    """Datagrams of lines. The first sender is the one that is listened to, until it falls silent."""

    wire = 0.0
    hint = "is that the sensor that sends there?"

    def __init__(self, name: str, host: str, port: int) -> None:
        self.name, self._address = name, (host, port)
        self._socket: socket.socket | None = None
        self._sender: tuple[str, int] | None = None
        self._silent = 0.0
        self.strangers = 0

    def open(self) -> None:
        """See `Port`."""
        host, port = self._address
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        made = socket.socket(family, socket.SOCK_DGRAM)
        try:
            made.bind((host, port))
        except OSError as error:
            made.close()
            raise PortTrouble(_short(error, "cannot be listened to")) from error
        made.settimeout(PATIENCE)
        self._socket = made

    def read(self) -> bytes:
        """See `Port`. Every datagram ends its last line."""
        assert self._socket is not None
        try:
            data, sender = self._socket.recvfrom(LARGEST + 1)
        except TimeoutError:
            self._silent += PATIENCE
            if self._silent > SENDER_KEPT:
                self._sender = None
            return b""
        except OSError as error:
            raise PortTrouble(_short(error, "is gone")) from error
        if self._sender is None:
            self._sender = sender[:2]
        if sender[:2] != self._sender:
            self.strangers += 1
            return b""
        self._silent = 0.0
        return data + b"\n" if len(data) <= LARGEST else b"?" * LARGEST + b"\n"

    def close(self) -> None:
        """See `Port`."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def _short(error: OSError | ValueError, what: str) -> str:
    number = getattr(error, "errno", None)
    if number in (errno.EAGAIN, errno.EBUSY):
        return f"{what}: another program has it"
    return f"{what}: {os.strerror(number)}" if number else what
