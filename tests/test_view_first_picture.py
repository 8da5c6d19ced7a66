"""`garbi view LOG` shows something before it has read or imported much, however long the log is."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from garbi_map.log import Image, LogWriter, open_log
from garbi_map.log.index import Index
from garbi_map.view import show, style
from garbi_map.view.show import send_first_image
from garbi_map.view.stream import new_recording, recording_file
from tests.sample_log import START, jpeg_like
from tests.view_scene import recorded

IMAGES, SIZE = 400, 60_000


@pytest.fixture(scope="module")
def long_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """24 MB of images in chunks of half a megabyte, with an encoder beside them."""
    path = tmp_path_factory.mktemp("long") / "long.mcap"
    with LogWriter(path, compression="", chunk_size=500_000) as log:
        for number in range(IMAGES):
            stamp = START + number * 50_000_000
            log.write_encoder(stamp, 0.1)
            log.write_image(Image(stamp, stamp, "jpeg", b"\xff\xd8" + jpeg_like(number % 7, SIZE)))
    return path


def test_the_first_image_costs_its_own_part_of_the_log(
    long_log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From opening to the first image three chunks of fifty are read: the first twice, the last for its stamps."""
    from garbi_map.view.blueprint import decision_blueprint

    read = 0

    class Counting:
        def __init__(self, file: object) -> None:
            self.file = file

        def read(self, size: int = -1) -> bytes:
            nonlocal read
            data = self.file.read(size)  # type: ignore[attr-defined]
            read += len(data)
            return data

        def seek(self, *at: int) -> int:
            return self.file.seek(*at)  # type: ignore[attr-defined]

        def __enter__(self) -> Counting:
            return self

        def __exit__(self, *_: object) -> None:
            self.file.close()  # type: ignore[attr-defined]

    opened = Index.open
    monkeypatch.setattr(Index, "open", lambda index: Counting(opened(index)))
    with recording_file(tmp_path / "first.rrd", "log", "first", decision_blueprint()) as recording:
        send_first_image(recording, open_log([long_log]))
    assert 0 < read < 0.08 * long_log.stat().st_size
    content = recorded(tmp_path / "first.rrd")
    assert [stamp for stamp in content[style.IMAGE]["stamp"] if stamp] == [START]


def test_a_log_without_images_has_no_first_image(tmp_path: Path) -> None:
    """And that is no reason to stop."""
    with LogWriter(tmp_path / "log.mcap") as log:
        log.write_encoder(START, 0.1)
    send_first_image(new_recording("log", "test"), open_log([tmp_path / "log.mcap"]))


def test_nothing_heavy_is_imported_before_the_viewer_starts() -> None:
    """Neither numpy nor Rerun nor compiled loops: the viewer starts at once, and they are imported beside it."""
    code = (
        "import sys, garbi_map.cli.view, garbi_map.view.show; "
        "print([name for name in ('numpy', 'scipy', 'rerun', 'numba', 'pydantic', 'mcap') if name in sys.modules])"
    )
    root = Path(show.__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=root)
    assert done.stdout.strip() == "[]"
