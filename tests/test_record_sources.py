"""The recorder driven for real: pty, UDP and images in; what goes wrong is told in one line and the rest goes on."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dive_logs import SAMPLE
from record_parts import Said, Sending, Serial, Udp, encoder_line, imu_line, recorder, sample_images, wait_for

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import open_log
from garbi_map.record.frames import Capture, frames_of
from garbi_map.record.lines import nmea
from garbi_map.record.recorder import Recorded, Recorder
from garbi_map.record.settings import RecordSettings
from garbi_map.stripe import decode


@pytest.fixture(scope="module")
def images(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A second of the sample log's images."""
    return sample_images(tmp_path_factory.mktemp("images") / "images")


@contextmanager
def running(recording: Recorder) -> Iterator[list[Recorded]]:
    """A recorder that runs for the length of a block; what it came to is in the list afterwards."""
    done: list[Recorded] = []
    thread = threading.Thread(target=lambda: done.append(recording.run()))
    thread.start()
    try:
        yield done
    finally:
        recording.stop()
        thread.join()


def quick() -> Config:
    """Silences are noticed early."""
    return Config(record=RecordSettings(silent=0.3, opening=0.3, retry=(0.1, 0.2)))


def test_a_camera_a_serial_encoder_and_an_imu_over_udp_make_a_log(images: Path, tmp_path: Path) -> None:
    """Everything that was sent is in the log, in order, images to the byte; the rig is attached, the clocks are written."""
    serial, udp, said = Serial(), Udp(), Said()
    rig = open_log([SAMPLE]).rig_text
    made = recorder(
        tmp_path / "a.mcap", said, images, 25.0, {serial.path: ("encoder",), udp.url: ("imu",)}, rig_text=rig
    )
    with running(made) as done, Sending(serial.send, encoder_line), Sending(udp.send, imu_line):
        wait_for(lambda: min(made.counts["encoder"], made.counts["imu"]) > 150 and made.counts["camera"] > 25)
    log = open_log(done[0].files)
    navigation = log.navigation()
    assert navigation.encoder is not None and navigation.imu is not None
    angles = np.round(navigation.encoder.angle * 1e4)
    assert len(angles) == done[0].counts["encoder"] and np.all(np.diff(angles) == 1)
    assert np.all(navigation.encoder.stamp_ns <= navigation.encoder.arrival_ns)
    assert np.diff(navigation.imu.stamp_ns[20:]).std() < 1e6  # by its own clock, whatever the machine was doing
    files = [file.read_bytes() for file in sorted(images.iterdir())]
    got = [bytes(image.data) for image in log.images()]
    assert len(got) > 20 and got == (files * 9)[: len(got)]
    assert log.rig_text is not None and log.losses == []
    assert "device's clock" in log.metadata["garbi.clocks"]["imu"]
    assert log.topics["/diagnostics"].count > 1


def test_an_encoder_that_is_unplugged_is_opened_again(images: Path, tmp_path: Path) -> None:
    """Both are told, and the images go on meanwhile."""
    said, first = Said(), Serial()
    link = tmp_path / "ttyUSB0"
    link.symlink_to(first.path)
    made = recorder(tmp_path / "a.mcap", said, images, 25.0, {str(link): ("encoder",)}, quick())
    with running(made) as done:
        with Sending(first.send, encoder_line):
            wait_for(lambda: made.counts["encoder"] > 20 and made.counts["camera"] > 10)
        first.unplug()
        said.wait_for("encoder: is gone")
        second = Serial()
        link.unlink()
        link.symlink_to(second.path)
        with Sending(second.send, encoder_line):
            said.wait_for("encoder: readings come again")
    log = open_log(done[0].files)
    assert any("is gone" in line for line in done[0].losses)
    gaps = np.diff([image.stamp_ns for image in log.images()]) * 1e-9
    assert len(gaps) > 10 and np.median(gaps) == pytest.approx(0.04)


def test_silence_garbage_and_a_wrong_baud_rate_are_told(images: Path, tmp_path: Path) -> None:
    """One line each; what is sound is recorded."""
    noisy, wrong, mute, said = Serial(), Serial(), Udp(), Said()
    ports: dict[str, Any] = {noisy.path: ("encoder",), wrong.path: ("imu",), mute.url: ("dvl",)}
    rng = np.random.default_rng(3)

    def noise(k: int) -> bytes:
        return encoder_line(k) if k % 3 else b"$PGRB,ENC,,0.1*00\r\n"

    with (
        running(recorder(tmp_path / "a.mcap", said, images, 25.0, ports, quick())) as done,
        Sending(noisy.send, noise),
        Sending(wrong.send, lambda _: rng.integers(128, 256, 40).astype(np.uint8).tobytes()),
    ):
        said.wait_for("imu: nothing that comes can be read; is the baud rate (115200) right?")
        said.wait_for("dvl: silent; nothing has come yet")
        said.wait_for("encoder: a line was left out: checksum does not match")
    assert said.text.count("checksum does not match") == 1
    assert open_log(done[0].files).navigation().encoder is not None
    assert any("checksum does not match" in line for line in done[0].losses)


def test_a_clock_that_is_set_back_is_told_and_written_down(images: Path, tmp_path: Path) -> None:
    """Stamps go on as before."""
    said, off = Said(), [0]
    made = recorder(tmp_path / "a.mcap", said, images, 25.0)
    made.clock._wall = lambda: time.time_ns() + off[0]
    with running(made) as done:
        wait_for(lambda: made.counts["camera"] > 5)
        off[0] = -3600 * 1_000_000_000
        said.wait_for("set back by 3600.0")
        wait_for(lambda: made.counts["camera"] > 15)
    log = open_log(done[0].files)
    assert done[0].losses == []
    assert np.all(np.diff([image.stamp_ns for image in log.images()]) > 0)
    assert "-3600" in log.metadata["garbi.clocks"]["system clock set by"]


def test_a_stranger_and_a_flood_over_udp_change_nothing(tmp_path: Path) -> None:
    """The first sender is listened to; more lines than a sensor sends are left out; a huge datagram is refused."""
    udp, said = Udp(), Said()
    stranger = Udp()
    stranger.port = udp.port
    config = Config(record=RecordSettings(most_lines=200, silent=30))
    made = recorder(tmp_path / "a.mcap", said, ports={udp.url: ("encoder",)}, config=config)
    with running(made) as done:
        with Sending(udp.send, encoder_line, 50.0):
            wait_for(lambda: made.counts["encoder"] > 10)
            for _ in range(20):
                stranger.send(nmea("PGRB,ENC,,9"))
            said.wait_for("encoder: a second sender is not listened to")
        udp.send(b"x" * 30_000)
        said.wait_for("too long")
        udp.send(nmea("PGRB,ENC,,5") * 150)
        udp.send(nmea("PGRB,ENC,,5") * 150)
        said.wait_for("more than 200 lines a second")
    encoder = open_log(done[0].files).navigation().encoder
    assert encoder is not None and 9.0 not in encoder.angle


def test_motion_jpeg_is_kept_as_it_is_and_other_films_are_encoded(images: Path, tmp_path: Path) -> None:
    """The camera's own JPEG is not touched; pixels become JPEG of the same picture."""
    import cv2

    pixels = [cv2.imread(str(file)) for file in sorted(images.iterdir())[:5]]
    height, width = pixels[0].shape[:2]
    for name, codec, kept in (("a.avi", cv2.VideoWriter.fourcc(*"MJPG"), True), ("b.avi", 0, False)):
        writer = cv2.VideoWriter(str(tmp_path / name), cv2.CAP_FFMPEG, codec, 50.0, (width, height))
        for picture in pixels:
            writer.write(picture)
        writer.release()
        frames = frames_of(str(tmp_path / name))
        frames.open()
        first = frames.next()
        frames.close()
        assert first is not None and isinstance(first.data, bytes) is kept
        made = recorder(tmp_path / f"{name}.mcap", Said(), tmp_path / name)
        with running(made) as done:
            wait_for(lambda made=made: made.counts["camera"] > 10)  # type: ignore[misc]
        stored = list(open_log(done[0].files).images())
        assert np.median(np.diff([image.stamp_ns for image in stored])) == 20_000_000
        assert np.abs(decode(stored[1]).astype(float) - pixels[1]).mean() < 3


class FakeDevice:
    """A V4L2 camera as OpenCV shows it: padded Motion JPEG, stamped by the steady clock; it goes away after a while."""

    opened = 0
    raw = True

    def __init__(self, where: object, backend: int) -> None:
        FakeDevice.opened += 1
        self._left = 12

    def set(self, which: int, value: float) -> bool:
        return True

    def get(self, which: int) -> float:
        return (time.monotonic_ns() - 4_000_000) * 1e-6

    def isOpened(self) -> bool:
        return FakeDevice.opened != 2

    def grab(self) -> bool:
        time.sleep(0.02)
        self._left -= 1
        return self._left >= 0

    def retrieve(self) -> tuple[bool, np.ndarray]:
        import simplejpeg

        file = simplejpeg.encode_jpeg(np.full((48, 64, 3), 90, np.uint8))
        return True, np.frombuffer(file + bytes(500), np.uint8)[None]

    def release(self) -> None:
        pass


def test_a_camera_that_goes_away_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Told, opened again with a pause that grows; the driver's stamps are used and the padding is cut off."""
    import cv2

    monkeypatch.setattr(cv2, "VideoCapture", FakeDevice)
    monkeypatch.setattr(FakeDevice, "opened", 0)
    said = Said()
    with running(recorder(tmp_path / "a.mcap", said, "/dev/video7", config=quick())) as done:
        said.wait_for("camera: gives no more images (/dev/video7); it is tried again")
        said.wait_for("camera: cannot be opened (/dev/video7)")
        said.wait_for("camera: images come again")
    stored = list(open_log(done[0].files).images())
    late = np.array([image.arrival_ns - image.stamp_ns for image in stored])
    assert np.all(late > 3_900_000) and np.all(np.diff([image.stamp_ns for image in stored]) > 0)
    assert bytes(stored[0].data).endswith(b"\xff\xd9")
    assert "driver" in open_log(done[0].files).metadata["garbi.clocks"]["camera"]


def test_a_device_that_gives_no_jpeg_is_left_to_opencv(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pixels that come although JPEG was asked for."""
    import cv2

    class Pixels(FakeDevice):
        converting = False

        def set(self, which: int, value: float) -> bool:
            Pixels.converting |= which == cv2.CAP_PROP_CONVERT_RGB and value == 1
            return True

        def retrieve(self) -> tuple[bool, np.ndarray]:
            return True, np.full((48, 64, 3 if Pixels.converting else 2), 90, np.uint8)

    monkeypatch.setattr(cv2, "VideoCapture", Pixels)
    monkeypatch.setattr(FakeDevice, "opened", 0)
    frames = Capture("0", "device", None, (64, 48), loop=False)
    frames.open()
    frame = frames.next()
    assert frame is not None and isinstance(frame.data, np.ndarray) and frame.data.shape == (48, 64, 3)


def test_a_password_is_not_written_down() -> None:
    """What a stream is called in the log and on the screen."""
    assert frames_of("rtsp://diver:secret@10.0.0.7/stream").name == "rtsp://10.0.0.7/stream"


@pytest.mark.parametrize(
    ("camera", "words"),
    [("nowhere.avi", "no such camera"), ("empty", "no .jpg or .png"), ("text.avi", "not a video that OpenCV reads")],
)
def test_a_camera_that_cannot_be_is_refused_at_once(tmp_path: Path, camera: str, words: str) -> None:
    """Before anything is written."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "text.avi").write_text("no film")
    with pytest.raises(GarbiError, match=words):
        frames_of(str(tmp_path / camera))


def test_files_that_are_no_images_are_left_out(tmp_path: Path, images: Path) -> None:
    """One among others, counted."""
    mixed = sample_images(tmp_path / "mixed", 3)
    (mixed / "0001.jpg").write_bytes(os.urandom(1000))
    said = Said()
    with running(recorder(tmp_path / "a.mcap", said, mixed, 50.0)) as done:
        said.wait_for("camera: an image that is neither JPEG nor PNG was left out")
    assert any("neither JPEG nor PNG" in line for line in done[0].losses)
