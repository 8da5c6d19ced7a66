"""Behaviours on what is being recorded: what they decide is what a replay decides, and they never fall silent."""

from __future__ import annotations

import json
import socket
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Garbi
from record_parts import Said, Sending, Udp, recorder, sample_images, wait_for
from test_record_sources import running

import behaviours.live_feed
import behaviours.record
from behaviours.decisions import COMMAND, DECISIONS, Decision
from behaviours.expectations import Plan
from behaviours.feed import Seen
from behaviours.helm import Helm, resolved
from behaviours.log_feed import LogFeed
from behaviours.pilot import Pilot
from behaviours.record import LiveBehaviours, subscribe
from behaviours.replay import decide_all, plan_of
from behaviours.types import Command
from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import Log, open_log
from garbi_map.record.lines import nmea
from garbi_map.record.settings import MountSettings, RecordSettings
from garbi_map.record.subscribers import Offer
from garbi_map.rig import parse_rig

WALL = Path(__file__).resolve().parents[1] / "logs" / "behaviour_wall.mcap"
RATE = 12.5  # Hz, of its images


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first three seconds of a dive towards a wall."""
    return sample_images(tmp_path_factory.mktemp("wall") / "wall", 38, WALL)


@pytest.fixture(scope="module")
def wall() -> Log:
    return open_log([WALL])


@pytest.fixture(scope="module")
def config(wall: Log) -> Config:
    """With the mounts of that vehicle."""
    mounts = {
        frame: MountSettings(xyz=tuple(mount.translation), quaternion_xyzw=tuple(mount.quaternion))  # type: ignore[arg-type]
        for frame, mount in wall.navigation().mounts.items()
    }
    return Config(record=RecordSettings(mounts=mounts))


@pytest.fixture
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """On a machine that is busy, late decisions count as well."""
    monkeypatch.setattr(behaviours.record, "OUTDATED_NS", 60_000_000_000)
    monkeypatch.setattr(behaviours.live_feed, "MOST_IMAGES", 1000)


def lines_of(wall: Log) -> tuple[list[bytes], list[bytes]]:
    """Encoder and IMU of the log as a serial line would carry them."""
    navigation = wall.navigation()
    assert navigation.encoder is not None and navigation.imu is not None
    begin = wall.begin_ns - 10_000_000_000
    encoder = [
        nmea(f"PGRB,ENC,{(stamp - begin) * 1e-9:.4f},{angle:.6f}")
        for stamp, angle in zip(navigation.encoder.stamp_ns.tolist(), navigation.encoder.angle.tolist(), strict=True)
    ]
    values = np.c_[navigation.imu.rate, navigation.imu.specific_force, navigation.imu.attitude]
    imu = [
        nmea(f"PGRB,IMU,{(stamp - begin) * 1e-9:.4f}," + ",".join(f"{value:.5f}" for value in row))
        for stamp, row in zip(navigation.imu.stamp_ns.tolist(), values.tolist(), strict=True)
    ]
    return encoder, imu


class Receiver:
    """Takes what a helm sends."""

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(0.1)
        self.address = f"127.0.0.1:{self._socket.getsockname()[1]}"
        self.got: list[dict[str, Any]] = []
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while True:
            try:
                self.got.append(json.loads(self._socket.recv(65536)))
            except TimeoutError:
                if self._over.is_set():
                    return

    def wait_for(self, wanted: Callable[[dict[str, Any]], bool]) -> None:
        wait_for(lambda: any(map(wanted, list(self.got))), lambda: f"never said, but: {self.got[-3:]}")

    def end(self) -> list[dict[str, Any]]:
        self._over.set()
        self._thread.join()
        return self.got


@contextmanager
def flying(
    wall: Log, images: Path, out: Path, config: Config, said: Said, send_to: str | None = None
) -> Iterator[tuple[LiveBehaviours, list[Any]]]:
    """The dive, recorded with the behaviours running."""
    assert wall.rig_text is not None
    plan = plan_of(wall, None)
    live = LiveBehaviours(plan, "", parse_rig(wall.rig_text, "wall"), config, send_to)
    udp, (encoder, imu) = Udp(), lines_of(wall)
    ports: dict[str, Any] = {udp.url: ("encoder", "imu")}
    made = recorder(out, said, images, RATE, ports, config, [live], wall.rig_text)
    with running(made) as done, Sending(udp.send, lambda k: encoder[k % len(encoder)] + imu[k % len(imu)]):
        yield live, done


def messages(log: Log, topic: str) -> list[Any]:
    """Of a topic, deserialised."""
    from garbi_map.log.types import standard_types

    types = standard_types()
    return [types.deserialize_cdr(raw.data, log.topics[topic].type) for _, raw in log.messages({topic})]


def stamp(message: Any) -> int:
    return int(message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec)


@pytest.mark.usefixtures("unhurried")
def test_a_replay_of_the_recording_decides_the_same(wall: Log, images: Path, tmp_path: Path, config: Config) -> None:
    """Every reason of every decision, and every command that the helm let through."""
    said = Said()
    with flying(wall, images, tmp_path / "a.mcap", config, said) as (live, done):
        wait_for(lambda: live.decided >= 28, lambda: said.text)
    log = open_log(done[0].files)
    replayed = {
        one.now_ns: one for one in decide_all(LogFeed(log, live.plan.behaviours.feed, config.stripe), live.plan)
    }
    told = messages(log, DECISIONS)
    sent = {stamp(message): message.twist for message in messages(log, COMMAND)}
    followed = 0
    for message in told:
        again = replayed[stamp(message)]
        words = {status.name: status.message for status in message.status}
        assert words["coordinator"] == again.merging
        assert words["safety"] == ("; ".join(again.changes) or "nothing to change")
        if words["helm"] == "as decided":
            followed += 1
            twist = sent[stamp(message)]
            got = np.array([twist.linear.x, twist.linear.z, twist.angular.z, twist.angular.y])
            assert np.abs(got - again.command.array()).max() < 1e-12
    assert followed > 15
    assert any(one.command != Command() for one in replayed.values())


def test_behaviours_that_fail_end_in_the_command_to_stop(
    wall: Log, images: Path, tmp_path: Path, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Said on the terminal and to the vehicle, again and again, while the recording goes on."""
    decide = Pilot.decide

    def failing(self: Pilot, seen: Seen) -> Decision:
        if seen.now_ns > 10**18 and len(receiver.got) > 5:
            raise ZeroDivisionError("of all things")
        return decide(self, seen)

    monkeypatch.setattr(Pilot, "decide", failing)
    receiver, said = Receiver(), Said()
    with flying(wall, images, tmp_path / "a.mcap", config, said, receiver.address) as (_, done):
        said.wait_for("behaviours: failed (ZeroDivisionError: of all things); the command is to stop")
        before = len(receiver.got)
        receiver.wait_for(lambda _: len(receiver.got) > before + 5)
    lines = receiver.end()
    assert all(line["stop"] and "ZeroDivisionError" in line["why"] for line in lines[before + 1 : -3])
    assert [line["why"] for line in lines[-3:]] == ["the recording ends"] * 3
    assert [line["number"] for line in lines] == list(range(1, len(lines) + 1))
    log = open_log(done[0].files)
    assert log.image_count == done[0].counts["camera"]
    assert log.topics[COMMAND].count == len(lines)


def test_behaviours_that_hang_end_in_the_command_to_stop(
    wall: Log, images: Path, tmp_path: Path, config: Config, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The helm's own thread notices."""
    decide, stuck = Pilot.decide, threading.Event()

    def hanging(self: Pilot, seen: Seen) -> Decision:
        if seen.now_ns > 10**18 and len(receiver.got) > 5:
            stuck.wait()
        return decide(self, seen)

    monkeypatch.setattr(Pilot, "decide", hanging)
    receiver = Receiver()
    with flying(wall, images, tmp_path / "a.mcap", config, Said(), receiver.address):
        receiver.wait_for(lambda line: line["stop"] and line["why"].startswith("no decision for"))
        stuck.set()
    receiver.end()


@pytest.mark.usefixtures("unhurried")
def test_a_feed_that_breaks_ends_in_the_command_to_stop(
    wall: Log, images: Path, tmp_path: Path, config: Config
) -> None:
    """Images that are no images: after a second nothing is decided on them any more."""
    broken = sample_images(tmp_path / "broken", 38, WALL)
    for file in sorted(broken.iterdir())[15:]:
        file.write_bytes(b"\xff\xd8 but no more")
    receiver, said = Receiver(), Said()
    with flying(wall, broken, tmp_path / "a.mcap", config, said, receiver.address):
        receiver.wait_for(lambda line: not line["stop"] or "nothing" in line["why"])
        receiver.wait_for(lambda line: line["stop"] and "no image could be used for" in line["why"])
        said.wait_for("behaviours: the feed is broken: no image could be used")
    receiver.end()


def test_a_helm_that_nobody_steers_says_stop() -> None:
    """From the first moment, and when decisions end; each command says how long it holds."""
    receiver, recorded = Receiver(), list[tuple[int, Command]]()
    helm = Helm(
        resolved(receiver.address),
        time.time_ns,
        lambda at, command: recorded.append((at, command)),
        print,
        patience=0.1,
    )
    helm.begin()
    receiver.wait_for(lambda line: line["why"] == "nothing is decided yet")
    helm.steer(123, Command(surge=0.2), "travel")
    receiver.wait_for(lambda line: line["surge"] == 0.2 and not line["stop"] and line["stamp_ns"] == 123)
    receiver.wait_for(lambda line: line["stop"] and line["why"].startswith("no decision for 0."))
    helm.end()
    lines = receiver.end()
    assert all(line["valid_for"] == 1.0 for line in lines)
    assert len(recorded) == len(lines)


def test_what_cannot_run_is_refused_at_once(wall: Log, tmp_path: Path) -> None:
    """No rig, no such host, no such file."""
    rig = parse_rig(wall.rig_text or "", "wall")
    plan = tmp_path / "plan.yaml"
    plan.write_text("behaviours: {}\n")
    with pytest.raises(GarbiError, match="needs the scanner's calibration"):
        subscribe(Offer(plan, None, Config(), None))
    with pytest.raises(GarbiError, match="cannot be read"):
        subscribe(Offer(tmp_path / "none.yaml", None, Config(), rig))
    with pytest.raises(GarbiError, match="HOST:PORT"):
        LiveBehaviours(Plan(), "", rig, Config(), "nowhere")


def test_the_command_finds_the_behaviours_where_they_are_installed(
    garbi: Garbi, wall: Log, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the entry point that pyproject.toml names; the log says what they were, and replays."""
    project = tomllib.loads((WALL.parents[1] / "pyproject.toml").read_text())["project"]
    installed = tmp_path / "garbi-9.dist-info"
    installed.mkdir()
    (installed / "METADATA").write_text("Metadata-Version: 2.1\nName: garbi\nVersion: 9\n")
    table = project["entry-points"]["garbi.subscribers"]
    named = "\n".join(f"{name} = {where}" for name, where in table.items())
    (installed / "entry_points.txt").write_text(f"[garbi.subscribers]\n{named}\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    (tmp_path / "rig.yaml").write_text(wall.rig_text or "")
    (tmp_path / "plan.yaml").write_text("behaviours: {travel: {speed: 0.15}}\n")
    receiver, out = Receiver(), tmp_path / "a.mcap"
    options = ("--behaviours", tmp_path / "plan.yaml", "--command-to", receiver.address, "--rig", tmp_path / "rig.yaml")
    ended = garbi("record", "-o", out, "--camera", images, "--rate", 20, *options)
    assert (
        ended.status == 3 and "the feed is broken: no image could be used yet" in ended.err
    )  # for there is no encoder
    assert all(line["stop"] for line in receiver.end())
    log = open_log([out])
    assert log.topics[COMMAND].count > 3
    assert plan_of(log, None).behaviours.travel.speed == 0.15  # type: ignore[union-attr]


def test_without_the_package_it_is_said(
    garbi: Garbi, images: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One line, exit status 1; and where the commands go makes no sense without behaviours."""
    monkeypatch.setattr("garbi_map.record.subscribers.entry_points", lambda **_: [])
    common = ("record", "-o", tmp_path / "a.mcap", "--camera", images)
    ended = garbi(*common, "--behaviours", tmp_path / "plan.yaml")
    assert ended.status == 1 and "not installed" in ended.err
    assert garbi(*common, "--command-to", "127.0.0.1:9").status == 2
