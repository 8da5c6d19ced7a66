"""`garbi view`: logs as they are, whatever is missing, and one clear line where nothing can be shown."""

from __future__ import annotations

import socket
from pathlib import Path

import numpy as np
import pytest

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import LogWriter, open_log
from garbi_map.view import style
from garbi_map.view.log_view import stream_log
from garbi_map.view.show import Wishes, recording_of, save_log
from garbi_map.view.stream import new_recording
from garbi_map.view.viewer import check_recording, viewer
from tests.sample_log import write_sample
from tests.view_scene import IMAGES, LOOK_DOWN, SEABED_Z, START, VEHICLE_Z, make_log, recorded


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_log(tmp_path_factory.mktemp("dive") / "dive.mcap")


def rows(content: dict[str, dict[str, list]], path: str, column: str) -> list:
    return [row for row in content[path][column] if row is not None]


def test_a_log_s_profiles_lie_on_the_seabed(dive: Path, tmp_path: Path) -> None:
    """Found in the images, by the encoder's angle, turned into the vehicle's frame: the plane that was painted."""
    assert save_log(dive, Wishes(), tmp_path / "log.rrd") == []
    content = recorded(tmp_path / "log.rrd")
    assert len(rows(content, style.IMAGE, "EncodedImage:blob")) == IMAGES
    profiles = rows(content, style.PROFILE.path, "Points3D:positions")
    from scipy.spatial.transform import Rotation

    own = np.concatenate([np.array(profile) for profile in profiles if len(profile)])
    down = Rotation.from_quat(LOOK_DOWN.quaternion).apply(own) + LOOK_DOWN.translation
    assert len(own) > 5000
    assert abs(np.median(down[:, 2]) - (SEABED_Z - VEHICLE_Z)) < 0.01


def test_depth_is_that_of_the_pressure(dive: Path, tmp_path: Path) -> None:
    """Ten metres of water above the air."""
    save_log(dive, Wishes(), tmp_path / "log.rrd")
    depth = np.array(rows(recorded(tmp_path / "log.rrd"), style.DEPTH.path, "Scalars:scalars"))
    np.testing.assert_allclose(depth, 10.0, atol=1e-9)


def test_the_first_images_come_at_once(dive: Path) -> None:
    """A log is sent in windows, the first one half a second long, so that something is seen however long the log is."""
    log = open_log([dive])
    sent = stream_log(new_recording("log", "test"), log, None, Config())
    assert next(sent) - log.begin_ns <= 500_000_000


@pytest.mark.parametrize("missing", ["image", "imu", "encoder", "navigation"])
def test_what_can_be_shown_is_shown(tmp_path: Path, missing: str) -> None:
    """A log without images, attitude, encoder or navigation still opens, its rig and its images unusable as they are."""
    log = write_sample(tmp_path / "log.mcap", skip=(missing,))
    lost = save_log(log, Wishes(), tmp_path / "log.rrd")
    assert any("rig.yaml" in line for line in lost)
    content = recorded(tmp_path / "log.rrd")
    assert any("images: neither JPEG nor PNG" in line for line in lost) == (missing != "image")
    assert ("Scalars:scalars" in content[style.ENCODER.path]) == (missing != "encoder")
    assert ("Scalars:scalars" in content[style.ATTITUDE.path]) == (missing != "imu")


def test_a_gap_is_a_band_and_a_line(tmp_path: Path) -> None:
    """An encoder that is silent for two seconds: the band begins and ends with the silence."""
    with LogWriter(tmp_path / "log.mcap") as log:
        for step in range(600):
            if not 200 <= step < 400:
                log.write_encoder(START + step * 10_000_000, 0.001 * step)
            log.write_imu(START + step * 10_000_000, [0, 0, 0], [0, 0, 9.8], [0, 0, 0, 1], np.eye(3) * 1e-4)
    save_log(tmp_path / "log.mcap", Wishes(), tmp_path / "log.rrd")
    content = recorded(tmp_path / "log.rrd")
    band = content[f"{style.LANES}/encoder"]
    states = [
        (stamp - START, row[0]) for stamp, row in zip(band["stamp"], band["StateChange:state"], strict=True) if row
    ]
    assert states == [(1_990_000_000, style.NOTHING), (4_000_000_000, "")]
    assert rows(content, style.LOSSES, "TextLog:text") == [["encoder: nothing for 2.0 s"]]


def test_a_damaged_stretch_is_marked_and_the_rest_is_shown(dive: Path, tmp_path: Path) -> None:
    """A third of the file zeroed: what is before and after it is there, a band says where it was."""
    data = bytearray(dive.read_bytes())
    data[len(data) // 3 : len(data) // 2] = bytes(len(data) // 2 - len(data) // 3)
    (tmp_path / "damaged.mcap").write_bytes(data)
    lost = save_log(tmp_path / "damaged.mcap", Wishes(), tmp_path / "log.rrd")
    assert any("lost" in line for line in lost)
    content = recorded(tmp_path / "log.rrd")
    assert 0 < len(rows(content, style.IMAGE, "EncodedImage:blob")) < IMAGES
    states = [row[0] for row in rows(content, f"{style.LANES}/log", "StateChange:state")]
    assert states[0] == style.DAMAGED and states[-1] == ""


def test_a_log_without_gaps_says_so(dive: Path, tmp_path: Path) -> None:
    """One band, over the whole log."""
    save_log(dive, Wishes(), tmp_path / "log.rrd")
    states = rows(recorded(tmp_path / "log.rrd"), f"{style.LANES}/log", "StateChange:state")
    assert states == [[style.WHOLE], [""]]


def test_unknown_topics_are_listed_and_left_alone(tmp_path: Path) -> None:
    """A log of nothing but somebody else's topic opens: the page names it."""
    with LogWriter(tmp_path / "log.mcap") as log:
        text = log.types.types["std_msgs/msg/String"](data="hello")
        log.write("/somebody/else", "std_msgs/msg/String", text, START)
    save_log(tmp_path / "log.mcap", Wishes(), tmp_path / "log.rrd")
    (page,) = rows(recorded(tmp_path / "log.rrd"), style.ABOUT, "TextDocument:text")
    assert "/somebody/else" in page[0]


def test_what_else_was_seen_is_drawn(dive: Path, tmp_path: Path) -> None:
    """Bars of twenty sigma lie about the stripe; the water beside it is as dark as it was painted, 12 to 18 of 255."""
    save_log(dive, Wishes(), tmp_path / "log.rrd")
    content = recorded(tmp_path / "log.rrd")
    bars = rows(content, style.STRIPE_SIGMA.path, "LineStrips2D:strips")
    stripes = rows(content, style.STRIPE.path, "Points2D:positions")
    assert len(bars) == len(stripes) == IMAGES
    bar, stripe = np.array(bars[IMAGES // 2]), np.array(stripes[IMAGES // 2])
    middle = np.interp(bar[:, 0, 1], stripe[:, 1], stripe[:, 0])
    assert np.median(np.abs(bar.mean(axis=1)[:, 0] - middle)) < 0.5
    assert (bar[:, 1, 0] > bar[:, 0, 0]).all()
    water = np.array(rows(content, style.BACKSCATTER.path, "Scalars:scalars"))
    assert 10.0 < np.nanmedian(water) < 20.0


def test_a_recording_is_not_much_larger_than_its_log(dive: Path, tmp_path: Path) -> None:
    """At most half as large again, with everything that is drawn; without images a fraction."""
    save_log(dive, Wishes(), tmp_path / "log.rrd")
    assert (tmp_path / "log.rrd").stat().st_size < 1.5 * dive.stat().st_size
    save_log(dive, Wishes(no_images=True), tmp_path / "bare.rrd")
    assert (tmp_path / "bare.rrd").stat().st_size < 0.5 * dive.stat().st_size


def test_a_recording_of_an_old_rerun_is_named(tmp_path: Path) -> None:
    """Its format can no longer be read; the way out is said."""
    (tmp_path / "old.rrd").write_bytes(b"RRF1" + bytes(60))
    with pytest.raises(GarbiError, match=r"older Rerun: make it again"):
        recording_of(tmp_path / "old.rrd")


def test_a_folder_that_is_no_map_says_what_to_do(tmp_path: Path) -> None:
    """A half-built map has no map.rrd."""
    with pytest.raises(GarbiError, match=r"holds no map\.rrd: finish the map"):
        recording_of(tmp_path)


def test_a_file_that_is_no_recording_is_refused(tmp_path: Path) -> None:
    """By its first bytes, not by its name."""
    (tmp_path / "a.rrd").write_bytes(b"something else")
    with pytest.raises(GarbiError, match="not a Rerun recording"):
        recording_of(tmp_path / "a.rrd")
    with pytest.raises(GarbiError, match="cannot be read"):
        check_recording(tmp_path / "b.rrd")


def test_a_log_is_told_from_a_recording(dive: Path) -> None:
    """An MCAP file is a log."""
    assert recording_of(dive) is None


def test_without_a_display_it_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line that names both ways out."""
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    monkeypatch.setattr("sys.platform", "linux")
    with pytest.raises(GarbiError, match=r"--web for a browser, or --save FILE\.rrd"), viewer(None, web=False):
        pass


def test_a_port_in_use_is_named() -> None:
    """And the option that chooses another one."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        why = f"port {port} is in use: choose another one with --port"
        with pytest.raises(GarbiError, match=why), viewer(None, web=True, port=port):
            pass


def test_the_page_for_a_browser_is_served() -> None:
    """The page answers on its port while the viewer is open, and is gone afterwards."""
    import time
    import urllib.request

    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with viewer(None, web=True, port=port) as opened:
        assert opened.page is not None
        for _ in range(50):
            try:
                page = urllib.request.urlopen(f"http://127.0.0.1:{port}/", timeout=5).read()
                break
            except OSError:
                time.sleep(0.2)
        assert b"<canvas" in page or b"rerun" in page.lower()
    assert opened.process.poll() is not None
