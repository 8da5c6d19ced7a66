"""Everything that a recording is made of, put together: sources, backlog, disk, and a watch over them."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogWriter
from garbi_map.record.backlog import Backlog
from garbi_map.record.clock import SteadyClock
from garbi_map.record.disk import STALLED, Disk, Target
from garbi_map.record.faults import Faults
from garbi_map.record.frames import Frames
from garbi_map.record.lines import Kind
from garbi_map.record.ports import Port
from garbi_map.record.preamble import begin_file, end_file, write_status
from garbi_map.record.quality import Looker
from garbi_map.record.sources import Camera, Lines, Source
from garbi_map.record.status import Meter, SourceStatus, Status
from garbi_map.record.subscribers import Recording, Subscriber
from garbi_map.rig import parse_rig

WATCH = 0.1  # s
TELL = 1.0  # s between two words of the recorder in the log
MESSAGE = 600  # bytes, about, of a reading that waits
JOIN = 3.0  # s for a source to stop
STRUGGLING = 4  # times the usual gap is a silence


@dataclass(frozen=True)
class Inputs:
    """What is recorded. ports: with the kinds of readings that are wanted from each."""

    frames: Frames | None
    ports: Sequence[tuple[Port, tuple[Kind, ...]]] = ()


@dataclass(frozen=True)
class Recorded:
    """What a recording came to: its files, how many messages of each source, and what was lost, one line each."""

    files: list[Path]
    counts: dict[str, int]
    losses: list[str]


class Recorder:
    """One recording. `run` is it; `stop` may be called from anywhere, a signal handler too.

    Raises GarbiError where the log cannot be begun.
    """

    def __init__(
        self,
        inputs: Inputs,
        target: Target,
        config: Config,
        say: Callable[[str], None],
        rig_text: str | None = None,
        subscribers: Sequence[Subscriber] = (),
        clock: SteadyClock | None = None,
    ) -> None:
        if inputs.frames is None and not inputs.ports:
            raise GarbiError("nothing to record: name a --camera or an --encoder")
        self.config, self.settings = config, config.record
        self.clock = clock or SteadyClock()
        self.faults = Faults(say)
        self._rig = None if rig_text is None else parse_rig(rig_text, "rig file")
        self._rig_text, self._subscribers = rig_text, list(subscribers)
        self._frame = self._rig.camera.frame_id if self._rig else "camera_optical_frame"
        self._joint = self._rig.laser.joint if self._rig else "laser_joint"
        self._stopping = threading.Event()
        self._jumps: list[str] = []
        self._told_dropped: dict[str, int] = {}
        self.backlog = Backlog(self.settings.backlog * 1_000_000)
        self._sources = self._make_sources(inputs)
        self._of_kind: dict[str, str] = {kind: ", ".join(kinds) for _, kinds in inputs.ports for kind in kinds}
        names = (["camera"] if inputs.frames else []) + list(self._of_kind)
        self._begin_ns = self.clock.now()
        self._meters = {name: Meter(self._begin_ns) for name in names}
        self._looker = (
            Looker(config.stripe, self._rig, self.settings.look, self.faults) if inputs.frames is not None else None
        )
        self._disk = Disk(
            target, config.log.topics, self.settings, self.backlog, self.clock, self.faults, self._begin, self._end
        )

    def _make_sources(self, inputs: Inputs) -> list[Source]:
        made: list[Source] = []
        if inputs.frames is not None:
            made.append(Camera(inputs.frames, self.settings, self.clock, self, self.faults))
        made += [Lines(port, kinds, self.settings, self.clock, self, self.faults) for port, kinds in inputs.ports]
        return made

    def stop(self) -> None:
        """End the recording, soon."""
        self._stopping.set()

    def run(self, seconds: float | None = None, show: Callable[[Status], None] = lambda _: None) -> Recorded:
        """Record until `stop`, for so many seconds, until a file that plays the camera ends, or until the disk is full.

        show: is given the state ten times a second.
        """
        self._disk.target.check()
        if self._looker is not None:
            self._looker.warm_up()
        self._disk.open()
        self._disk.start()
        try:
            recording = Recording(self.clock, self.faults, self.backlog.put)
            for one in self._subscribers:
                one.begin(recording)
            for meter in self._meters.values():
                meter.last_ns = self.clock.now()
            for thread in (*self._sources, *([self._looker] if self._looker else [])):
                thread.start()
            self._watch(seconds, show)
        finally:
            self._end_all()
        return self._outcome()

    def _watch(self, seconds: float | None, show: Callable[[Status], None]) -> None:
        told = begin = self.clock.now()
        while not self._stopping.wait(WATCH):
            now = self.clock.now()
            self._look_for_faults(now)
            status = self.status(now)
            show(status)
            if now - told >= TELL * 1e9:
                told = now
                self.backlog.put("recorder", MESSAGE, partial(_write_status, now, status, self.clocks()))
            if self._disk.full or (seconds is not None and now - begin >= seconds * 1e9):
                return

    def _look_for_faults(self, now: int) -> None:
        by = self.clock.jump()
        if by is not None:
            self.faults.note(
                f"clock: the system's clock was set {'on' if by > 0 else 'back'} by {abs(by):.3f} s; stamps go on as before"
            )
            self._jumps.append(f"{by:+.6f} s at {now}")
        stalled = self._disk.stalled(now)
        if stalled > STALLED:
            self.faults.tell(
                "disk", "it takes nothing", f" since {stalled:.1f} s; {self.backlog.waiting_bytes / 1e6:.0f} MB wait"
            )
        for name, meter in self._meters.items():
            silence = meter.silence(now)
            most = max(self.settings.silent, STRUGGLING * meter.usual_gap()) if meter.count else self.settings.opening
            if silence > most and not self._trouble(name):
                self.faults.down(name, "silent", f" for {silence:.1f} s" if meter.count else "; nothing has come yet")
        for name, count in self.backlog.dropped.items():
            if count > self._told_dropped.get(name, 0):
                self._told_dropped[name] = count
                self.faults.tell("disk", f"too slow: what {name} gives is dropped", f", {count} so far")

    def _trouble(self, name: str) -> str | None:
        return self.faults.lasting(name) or self.faults.lasting(self._of_kind.get(name, name))

    def status(self, now: int) -> Status:
        """The state of now."""
        rates = {name: meter.rates(now) for name, meter in self._meters.items()}
        dropped = self.backlog.dropped
        return Status(
            (now - self._begin_ns) * 1e-9,
            self._disk.files[-1].name if self._disk.files else "",
            [
                SourceStatus(name, rates[name][0], meter.count, dropped.get(name, 0), self._trouble(name))
                for name, meter in self._meters.items()
            ],
            self.backlog.waiting_bytes,
            self.backlog.most_bytes,
            self._disk.bytes,
            sum(rate for _, rate in rates.values()),
            self._disk.free,
            self._disk.stalled(now),
            self._looker.last if self._looker else None,
            [one.status() for one in self._subscribers],
        )

    @property
    def counts(self) -> dict[str, int]:
        """Images and readings of each source so far."""
        return {name: meter.count for name, meter in self._meters.items()}

    def clocks(self) -> dict[str, str]:
        """Of each source, how its stamps come about."""
        found = {source.source: source.clocks() for source in self._sources}
        if self._jumps:
            found["system clock set by"] = "; ".join(self._jumps)
        return found

    def image(self, image: Image) -> None:
        """See `garbi_map.record.sources.Sink`."""
        size = len(image.data)
        self._meters["camera"].add(image.arrival_ns, size)
        self.faults.up("camera", "images come again")
        self.backlog.put("camera", size, lambda log: log.write_image(image, self._frame), image=True)
        if self._looker is not None:
            self._looker.see(image)
        for one in self._subscribers:
            with self._guarded():
                one.image(image)

    def reading(self, kind: Kind, stamp_ns: int, arrival_ns: int, values: tuple[float, ...]) -> None:
        """See `garbi_map.record.sources.Sink`."""
        self._meters[kind].add(arrival_ns, MESSAGE)
        self.faults.up(kind, "readings come again")
        self.faults.up(self._of_kind[kind], "readings come again")
        self.backlog.put(kind, MESSAGE, lambda log: write_reading(log, kind, stamp_ns, arrival_ns, values, self._joint))
        for one in self._subscribers:
            with self._guarded():
                one.reading(kind, stamp_ns, arrival_ns, values)

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        """A subscriber's fault is its own."""
        try:
            yield
        except Exception as error:
            self.faults.tell("subscriber", f"failed ({type(error).__name__}: {error})")

    def ended(self, source: str) -> None:
        """See `garbi_map.record.sources.Sink`."""
        self.faults.note(f"{source}: its file is at its end")
        self.stop()

    def _begin(self, log: LogWriter) -> None:
        called = {source.source: source.called for source in self._sources}
        metadata = {name: record for one in self._subscribers for name, record in one.metadata.items()}
        begin_file(log, self.clock.now(), self.settings, called, self._rig, self._rig_text, metadata)

    def _end(self, log: LogWriter) -> None:
        end_file(log, self.clocks(), self.faults.lines())

    def _end_all(self) -> None:
        for source in self._sources:
            source.stopping.set()
        for source in self._sources:
            if source.is_alive():
                source.join(JOIN)
        if self._looker is not None:
            self._looker.stop()
        for one in self._subscribers:
            with self._guarded():
                one.end()
        self.backlog.close()
        self._disk.join()

    def _outcome(self) -> Recorded:
        counts = self.counts
        if not any(counts.values()):
            for file in self._disk.files:
                file.unlink(missing_ok=True)
            why = "; ".join(self.faults.lines())
            raise GarbiError(f"nothing was recorded{': ' + why if why else ''}")
        dropped = [f"{count} of {name} dropped, the disk was too slow" for name, count in self.backlog.dropped.items()]
        return Recorded(self._disk.files, counts, [*dropped, *self.faults.lines()])


def _write_status(now: int, status: Status, clocks: dict[str, str], log: LogWriter) -> None:
    write_status(log, now, status, clocks)


def write_reading(
    log: LogWriter, kind: Kind, stamp_ns: int, arrival_ns: int, values: tuple[float, ...], joint: str
) -> None:
    """A reading as the message that its kind has in a log."""
    if kind == "encoder":
        log.write_encoder(stamp_ns, values[0], arrival_ns, joint)
    elif kind == "imu":
        attitude = values[6:10] if len(values) == 10 else None
        log.write_imu(stamp_ns, values[:3], values[3:6], attitude, arrival_ns=arrival_ns)
    elif kind == "pressure":
        log.write_pressure(stamp_ns, values[0], arrival_ns)
    else:
        covariance = np.eye(3) * values[3] if len(values) == 4 else None
        log.write_dvl(stamp_ns, values[:3], covariance, arrival_ns)
