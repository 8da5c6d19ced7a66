"""`garbi record --behaviours`: the behaviours decide on what is being recorded, as a replay of the log will decide again."""

from __future__ import annotations

import threading
from functools import partial

import numpy as np

from behaviours.decisions import OK, WARN, Decision, DecisionWriter
from behaviours.expectations import Plan, load_plan
from behaviours.feed import Seen
from behaviours.helm import STOP, Helm, resolved
from behaviours.live_feed import LiveFeed
from behaviours.pilot import Pilot
from behaviours.replay import RECORD
from behaviours.types import Command
from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogWriter
from garbi_map.record.lines import Kind
from garbi_map.record.subscribers import Offer, Recording
from garbi_map.rig import Rig

MARGIN_NS = 5_000_000  # after a moment everything that arrived by then has been handed over
STRETCH_NS = 20_000_000  # between two looks for images to search
OUTDATED_NS = 400_000_000  # a decision for a moment this long ago is not made any more
SAID = 3000  # bytes, about, of a decision with its reasons
WORDS = 160  # characters of reasons that are sent with a command


def subscribe(offer: Offer) -> LiveBehaviours:
    """What `garbi record` finds under the name `behaviours`. Raises GarbiError."""
    if offer.rig is None:
        raise GarbiError("--behaviours needs the scanner's calibration; give it with --rig")
    text = offer.file.read_text() if offer.file.is_file() else ""
    return LiveBehaviours(load_plan(offer.file), text, offer.rig, offer.config, offer.send_to)


class LiveBehaviours:
    """See `garbi_map.record.subscribers.Subscriber`. Two threads: one decides, the helm's watches that it does.

    A feed that shows nothing usable for `feed.sensor_silent` seconds, or decisions that fail, end in the command to stop.
    """

    def __init__(self, plan: Plan, text: str, rig: Rig, config: Config, send_to: str | None = None) -> None:
        self.plan, self._config, self._rig = plan, config, rig
        self._address = None if send_to is None else resolved(send_to)
        self.metadata = {"garbi.behaviours": {"json": plan.model_dump_json()}}
        if text:
            self.metadata[RECORD] = {"yaml": text}
        self._mounts = {frame: pose.mount() for frame, pose in config.record.mounts.items()}
        self._feed = self._new_feed()
        self._pilot = Pilot(plan.behaviours, rig, self._feed.mount)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="garbi behaviours", daemon=True)
        self._profile_ns: int | None = None
        self.decided = self.missed = 0
        self._warm_up()

    def _new_feed(self) -> LiveFeed:
        return LiveFeed(self._rig, self._mounts, self.plan.behaviours.feed, self._config.stripe)

    def _warm_up(self) -> None:
        """A decision on a black image, thrown away: what is compiled or loaded at first use is, before it matters."""
        import simplejpeg

        camera, feed = self._rig.camera, self._new_feed()
        pilot = Pilot(self.plan.behaviours, self._rig, feed.mount)
        black = simplejpeg.encode_jpeg(np.zeros((camera.height, camera.width, 3), np.uint8))
        for k in range(4):
            feed.add_reading("encoder", k * 10_000_000, k * 10_000_000, (0.01 * k,))
            feed.add_image(Image(k * 10_000_000, k * 10_000_000, "jpeg", black))
            pilot.decide(feed.until((k + 4) * 10_000_000))

    def begin(self, recording: Recording) -> None:
        """See `Subscriber`."""
        self._recording = recording
        self._helm = Helm(
            self._address, recording.clock.now, self._record_command, partial(recording.faults.tell, "helm")
        )
        self._helm.begin()
        self._thread.start()

    def image(self, image: Image) -> None:
        """See `Subscriber`."""
        self._feed.add_image(image)

    def reading(self, kind: Kind, stamp_ns: int, arrival_ns: int, values: tuple[float, ...]) -> None:
        """See `Subscriber`."""
        self._feed.add_reading(kind, stamp_ns, arrival_ns, values)

    def status(self) -> str:
        """See `Subscriber`."""
        return f"behaviours: {self._helm.last}"

    def end(self) -> None:
        """See `Subscriber`."""
        self._ended.set()
        self._thread.join(2.0)
        self._helm.end()

    def _run(self) -> None:
        try:
            self._decide_all()
        except Exception as error:  # whatever it is: the vehicle stops, and the recording goes on
            why = f"the behaviours failed ({type(error).__name__}: {error})"
            self._helm.fail(why)
            self._recording.faults.down(
                "behaviours", "failed", f" ({type(error).__name__}: {error}); the command is to stop"
            )

    def _decide_all(self) -> None:
        """A decision per period, counted from the first thing that became known, as a replay counts them."""
        clock, period = self._recording.clock, round(self.plan.behaviours.feed.period * 1e9)
        tick = 0
        while not self._ended.is_set():
            begin = self._feed.begin_ns
            now = clock.now() - MARGIN_NS
            due = None if begin is None else begin + (tick + 1) * period
            if due is None or due > now:
                self._feed.take_in(now)
                self._ended.wait(min(STRETCH_NS, STRETCH_NS if due is None else max(due - now, 1)) * 1e-9)
                continue
            tick += 1
            seen = self._feed.until(due)
            if clock.now() - due > OUTDATED_NS:
                self.missed += 1
                self._recording.faults.tell("behaviours", "too slow for their period; a decision was left out")
                continue
            self._act(self._pilot.decide(seen), self._broken(seen))

    def _broken(self, seen: Seen) -> str | None:
        """Why the feed cannot be acted on, None where it can."""
        if seen.profiles:
            self._profile_ns = seen.profiles[-1].known_ns
        if self._profile_ns is None:
            return "no image could be used yet"
        silence = (seen.now_ns - self._profile_ns) * 1e-9
        if silence > self.plan.behaviours.feed.sensor_silent:
            return f"no image could be used for {silence:.1f} s" + "".join(f"; {words}" for words in seen.troubles)
        return next((words for words in seen.troubles if "silent" in words), None)

    def _act(self, decision: Decision, broken: str | None) -> None:
        self.decided += 1
        if broken is None:
            self._recording.faults.up("behaviours", "the feed is whole again")
            command, why = decision.command, f"{decision.winner}: {decision.merging}"[:WORDS]
        else:
            self._recording.faults.down("behaviours", "the feed is broken", f": {broken}; the command is to stop")
            command, why = STOP, broken
        self._helm.steer(decision.now_ns, command, why)
        level = OK if broken is None else WARN
        said: tuple[int, str, str, dict[str, str]] = (level, "helm", broken or "as decided", {})
        self._recording.write("behaviours", SAID, lambda log: DecisionWriter(log).write_reasons(decision, said))

    def _record_command(self, stamp_ns: int, command: Command) -> None:
        def write(log: LogWriter) -> None:
            DecisionWriter(log).write_command(stamp_ns, command)

        self._recording.write("behaviours", SAID // 10, write)
