"""`garbi view`: logs as they are, whatever is missing, and one clear line where nothing can be shown."""

from __future__ import annotations

import socket
from pathlib import Path

import numpy as np
import pytest

from garbi_map.config import Config
from garbi_map.errors import GarbiError
from garbi_map.log import open_log
from garbi_map.view import style
from garbi_map.view.log_view import stream_log
from garbi_map.view.show import Wishes, recording_of, save_log
from garbi_map.view.stream import new_recording
from garbi_map.view.viewer import check_recording, viewer
from tests.sample_log import write_sample
from tests.view_scene import IMAGES, LOOK_DOWN, SEABED_Z, VEHICLE_Z, make_log, recorded


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
    sent = stream_log(new_recording("test"), log, None, Config())
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
