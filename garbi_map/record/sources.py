"""The threads that take in images and readings, stamp them, and go on when a device goes away and comes back."""

from __future__ import annotations

import threading
from typing import Protocol

from garbi_map.log import Image
from garbi_map.record.clock import DeviceClock, EvenClock, SteadyClock
from garbi_map.record.faults import Faults
from garbi_map.record.frames import CameraTrouble, Frame, Frames
from garbi_map.record.lines import LONGEST, BadLine, Kind, LineSplitter, Reading, parse_line
from garbi_map.record.ports import Port, PortTrouble
from garbi_map.record.settings import RecordSettings

UNREADABLE = 2 * LONGEST  # bytes without a single sound line are not a glitch
LATE_NS = 1_000_000_000
BEGIN_NS = 2_000_000_000  # from a steady camera clock to now, at most


class Sink(Protocol):
    """What takes everything in; called from the sources' threads."""

    def image(self, image: Image) -> None:
        """One image."""

    def reading(self, kind: Kind, stamp_ns: int, arrival_ns: int, values: tuple[float, ...]) -> None:
        """One measurement."""

    def ended(self, source: str) -> None:
        """A file is at its end."""


class Source(threading.Thread):
    """A thread that opens something, takes from it, and opens it again, later and later, when it is gone."""

    def __init__(self, name: str, settings: RecordSettings, clock: SteadyClock, sink: Sink, faults: Faults) -> None:
        super().__init__(name=f"garbi {name}", daemon=True)
        self.source, self.settings, self.clock, self.sink, self.faults = name, settings, clock, sink, faults
        self.stopping = threading.Event()
        self.how = "not yet seen"  # the stamps come about, in words
        self._last_ns: dict[str, int] = {}

    def run(self) -> None:
        """Until `stopping` is set or a file is at its end."""
        wait, longest = self.settings.retry
        while not self.stopping.is_set():
            begin_ns = self.clock.now()
            try:
                self.take_all()
                break
            except (CameraTrouble, PortTrouble) as error:
                self.faults.down(self.source, str(error), f" ({self.called}); it is tried again")
            except Exception as error:  # whatever a driver throws: the other sources go on
                why = f"{type(error).__name__}: {error}"
                self.faults.down(self.source, "failed", f" ({self.called}: {why}); it is tried again")
            if self.clock.now() - begin_ns > 2e9 * longest:
                wait = self.settings.retry[0]
            self.stopping.wait(wait)
            wait = min(2 * wait, longest)
        if not self.stopping.is_set():
            self.sink.ended(self.source)

    def after(self, name: str, stamp_ns: int) -> int:
        """The stamp, or the moment behind the one before: a better guess of the delays must not swap two measurements."""
        stamp_ns = self._last_ns[name] = max(stamp_ns, self._last_ns.get(name, 0) + 1)
        return stamp_ns

    @property
    def called(self) -> str:
        """What the user calls it."""
        raise NotImplementedError

    def take_all(self) -> None:
        """Open, take until `stopping` or the end, close. Raises what `run` knows."""
        raise NotImplementedError

    def clocks(self) -> str:
        """How the stamps come about, with offset and rate, for the log."""
        return self.how


class Camera(Source):
    """Images, encoded where they are not."""

    def __init__(
        self, frames: Frames, settings: RecordSettings, clock: SteadyClock, sink: Sink, faults: Faults
    ) -> None:
        super().__init__("camera", settings, clock, sink, faults)
        self._frames = frames
        self._latency_ns = round(settings.latency.camera * 1e9)
        self._device, self._even = DeviceClock(), EvenClock()
        self._due_ns = 0

    @property
    def called(self) -> str:
        """See `Source`."""
        return self._frames.name

    def take_all(self) -> None:
        """See `Source`."""
        self._device, self._even = DeviceClock(), EvenClock()
        self._frames.open()
        try:
            period = None if self._frames.rate is None else round(1e9 / self._frames.rate)
            self._due_ns = self.clock.now()
            while not self.stopping.wait(max(self._due_ns - self.clock.now(), 0) * 1e-9 if period else 0.0):
                frame = self._frames.next()
                arrival_ns = self.clock.now()
                if frame is None:
                    return
                self._give(frame, arrival_ns, self.after("camera", self._stamp(frame, arrival_ns, period)))
        finally:
            self._frames.close()

    def _stamp(self, frame: Frame, arrival_ns: int, period: int | None) -> int:
        if period is not None:
            stamp, self._due_ns, self.how = self._due_ns, self._due_ns + period, "file, played at its rate"
            if arrival_ns - stamp > LATE_NS:
                self.faults.tell(self.source, "the file is read slower than it should be played")
                self._due_ns = arrival_ns
            return stamp
        if frame.device_ns is not None and frame.steady:
            stamp = self.clock.of_steady(frame.device_ns)
            if 0 <= arrival_ns - stamp < BEGIN_NS:
                self.how = "driver's stamp, this machine's steady clock"
                return stamp - self._latency_ns
        if frame.device_ns is not None:
            self.how = "camera's clock"
            return self._device.stamp(frame.device_ns, arrival_ns) - self._latency_ns
        stamp = self._even.stamp(arrival_ns)
        self.how = "even rate" if self._even.even else "arrival"
        return stamp - self._latency_ns

    def _give(self, frame: Frame, arrival_ns: int, stamp_ns: int) -> None:
        if isinstance(frame.data, bytes):
            if not frame.encoding:
                self.faults.tell(self.source, "an image that is neither JPEG nor PNG was left out")
                return
            self.sink.image(Image(stamp_ns, arrival_ns, frame.encoding, frame.data))
            return
        import simplejpeg

        pixels = frame.data
        if pixels.dtype != "uint8":
            pixels = (pixels >> 8).astype("uint8")
        colour = pixels.ndim == 3 and pixels.shape[2] == 3
        data = simplejpeg.encode_jpeg(
            pixels if pixels.ndim == 3 else pixels[:, :, None],
            quality=self.settings.jpeg_quality,
            colorspace="BGR" if colour else "GRAY",
            colorsubsampling=self.settings.jpeg_chroma if colour else "Gray",
        )
        self.sink.image(Image(stamp_ns, arrival_ns, "jpeg", data))

    def clocks(self) -> str:
        """See `Source`."""
        if self.how == "camera's clock":
            return f"{self.how}: {_said(self._device)}"
        return self.how


class Lines(Source):
    """Readings from the lines of one port, of the kinds that were asked for."""

    def __init__(
        self,
        port: Port,
        kinds: tuple[Kind, ...],
        settings: RecordSettings,
        clock: SteadyClock,
        sink: Sink,
        faults: Faults,
    ) -> None:
        super().__init__(", ".join(kinds), settings, clock, sink, faults)
        self.port, self.kinds = port, kinds
        self._latency_ns = {kind: round(getattr(settings.latency, kind) * 1e9) for kind in kinds}
        self._device = DeviceClock()
        self._even = {kind: EvenClock() for kind in kinds}
        self._ways: dict[Kind, str] = {}
        self._unread = 0
        self._second, self._lines = 0, 0
        self._strangers = 0

    @property
    def called(self) -> str:
        """See `Source`."""
        return self.port.name

    def take_all(self) -> None:
        """See `Source`."""
        self.port.open()
        splitter, self._unread = LineSplitter(), 0
        try:
            while not self.stopping.is_set():
                data = self.port.read()
                arrival_ns = self.clock.now()
                lines = splitter.split(data)
                later = sum(map(len, lines)) + len(lines)
                for line in lines:
                    later -= len(line) + 1
                    if self._may(arrival_ns):
                        self._take(line, arrival_ns, round(1e9 * self.port.wire * (len(line) + 1 + later)))
                self._look_at(len(data) if not lines else 0)
        finally:
            self.port.close()

    def _may(self, arrival_ns: int) -> bool:
        """Whether this second has room for another line."""
        second = arrival_ns // 1_000_000_000
        if second != self._second:
            self._second, self._lines = second, 0
        self._lines += 1
        if self._lines <= self.settings.most_lines:
            return True
        self.faults.tell(self.source, f"more than {self.settings.most_lines} lines a second; the rest is left out")
        return False

    def _take(self, line: bytes, arrival_ns: int, wire_ns: int) -> None:
        try:
            readings = parse_line(line)
        except BadLine as reason:
            self._unread += len(line)
            if self._unread < UNREADABLE:
                self.faults.tell(self.source, f"a line was left out: {reason}", f" ({self.called})")
            return
        self._unread = 0
        for reading in readings:
            if reading.kind in self.kinds:
                stamp_ns = self._stamp(reading, arrival_ns - wire_ns) - self._latency_ns[reading.kind]
                self.sink.reading(reading.kind, self.after(reading.kind, stamp_ns), arrival_ns, reading.values)
            else:
                self.faults.tell(self.source, f"it sends {reading.kind} too, which is not asked for and left out")

    def _look_at(self, unfinished: int) -> None:
        """Bytes that make no lines are the mark of a wrong baud rate."""
        self._unread += unfinished
        if self._unread >= UNREADABLE:
            self.faults.down(self.source, f"nothing that comes can be read; {self.port.hint}", f" ({self.called})")
        strangers = getattr(self.port, "strangers", 0)
        if strangers != self._strangers:
            self._strangers = strangers
            self.faults.tell(self.source, "a second sender is not listened to", f" ({self.called})")

    def _stamp(self, reading: Reading, arrival_ns: int) -> int:
        if reading.device_ns is not None:
            before = self._device.resets
            stamp = self._device.stamp(reading.device_ns, arrival_ns)
            if self._device.resets != before:
                self.faults.tell(self.source, "its clock jumped; the offset is found anew")
            self._ways[reading.kind] = "device's clock"
            return stamp
        even = self._even[reading.kind]
        stamp = even.stamp(arrival_ns)
        self._ways[reading.kind] = "even rate" if even.even else "arrival"
        return stamp

    def clocks(self) -> str:
        """See `Source`."""
        parts = []
        for kind, way in self._ways.items():
            more = ""
            if way == "device's clock":
                more = f": {_said(self._device)}"
            elif way == "even rate":
                even = self._even[kind]
                more = f": period {even.period_ns * 1e-6:.4f} ms, {even.slips} found missing"
            parts.append(f"{kind}: {way}{more}")
        return "; ".join(parts) or "nothing came"


def _said(clock: DeviceClock) -> str:
    return f"offset {clock.offset_ns * 1e-9:+.6f} s, rate {clock.skew * 1e6:+.2f} ppm, set {clock.resets} times"
