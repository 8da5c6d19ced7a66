"""`garbi stripe`: a table, pictures and a learnt gate, each complete or absent."""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path
from unittest import mock

import cv2
import numpy as np
import pyarrow.parquet as pq
import pytest
import yaml

from garbi_map.cli import main
from garbi_map.config import load_config
from garbi_map.errors import GarbiError
from garbi_map.log import Image, LogWriter
from garbi_map.stripe import ImageLosses, Stripe, StripeDetector, StripeSettings, decode
from garbi_map.stripe.learn import learn_settings
from garbi_map.stripe.table import write_stripes
from tools.bench.stripe_images import CONDITIONS, HEIGHT, synthetic

START = 1_790_000_000_000_000_000


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six images at 25 Hz, without a rig; the fourth is cut off."""
    path = tmp_path_factory.mktemp("stripe") / "dive.mcap"
    with LogWriter(path) as writer:
        for number in range(6):
            data = cv2.imencode(".jpg", synthetic(CONDITIONS[1], number)[0], [cv2.IMWRITE_JPEG_QUALITY, 95])[
                1
            ].tobytes()
            stamp = START + number * 40_000_000
            writer.write_image(Image(stamp, stamp, "jpeg", data[:2000] if number == 3 else data))
    return path


def run(*arguments: object) -> tuple[int, str]:
    """Exit status and everything printed."""
    said = io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["garbi", "stripe", *map(str, arguments)]),
        contextlib.redirect_stdout(said),
        contextlib.redirect_stderr(said),
        pytest.raises(SystemExit) as ended,
    ):
        main()
    return int(ended.value.code or 0), said.getvalue()


def test_the_table_holds_every_row_of_every_usable_image(log: Path, tmp_path: Path) -> None:
    """Columns as documented, near the truth; the lost image is named and the exit status is 3."""
    status, output = run(log, "-o", tmp_path / "s.parquet")
    assert status == 3
    assert "left out: 1 image: a damaged JPEG" in output
    table = pq.read_table(tmp_path / "s.parquet")
    assert table.column_names == ["stamp_ns", "row", "u", "sigma", "intensity"]
    stamp = table["stamp_ns"].to_numpy()
    assert sorted(set(stamp)) == [START + n * 40_000_000 for n in (0, 1, 2, 4, 5)]
    for number in (0, 1, 2, 4, 5):
        here = stamp == START + number * 40_000_000
        assert here.sum() > 0.99 * HEIGHT
        truth = synthetic(CONDITIONS[1], number)[1][table["row"].to_numpy()[here]]
        assert np.abs(table["u"].to_numpy()[here] - truth).max() < 1.0
    assert [file.name for file in tmp_path.iterdir()] == ["s.parquet"]


def test_pictures_are_twice_as_large_and_named_after_the_stamp(log: Path, tmp_path: Path) -> None:
    """One per usable image that was asked for."""
    run(log, "--overlay", tmp_path / "pictures", "--pictures", 6)
    names = sorted(file.name for file in (tmp_path / "pictures").iterdir())
    assert names == [f"stripe_{START + n * 40_000_000}.png" for n in (0, 1, 2, 4, 5)]
    picture = cv2.imread(str(tmp_path / "pictures" / names[0]))
    assert picture.shape == (1152, 1536, 3)
    truth = synthetic(CONDITIONS[1], 0)[1]
    around = picture[600, round(2 * truth[300]) - 6 : round(2 * truth[300]) + 8]
    assert (around[:, 2] > 180).any()  # the red mark of the choice, where the stripe has nothing red


def test_the_learnt_gate_is_a_configuration_that_finds_the_stripe(log: Path, tmp_path: Path) -> None:
    """Green here; the file holds nothing else."""
    run(log, "--learn", tmp_path / "gate.yaml")
    settings = load_config(tmp_path / "gate.yaml").stripe
    assert settings.laser == "green"
    assert settings.gate.hue is not None
    low, high = settings.gate.hue
    assert low < 132 < high  # the hue of (blue 0.25, green 1, red 0.08) is 131 degrees
    assert set(yaml.safe_load((tmp_path / "gate.yaml").read_text())["stripe"]) == {"laser", "gate"}
    run(log, "-o", tmp_path / "s.parquet", "--config", tmp_path / "gate.yaml")
    assert pq.read_metadata(tmp_path / "s.parquet").num_rows > 0.99 * 5 * HEIGHT


@pytest.mark.parametrize(("laser", "channel", "hue"), [("red", 2, 349), ("blue", 0, 229)])
def test_red_and_blue_lasers_are_learnt(laser: str, channel: int, hue: float) -> None:
    """The green laser's images with channels exchanged: the channel is found, and the gate holds the hue."""
    images = []
    for seed in range(2):
        pixels = synthetic(CONDITIONS[1], seed)[0]
        turned = pixels.copy()
        turned[:, :, [1, channel]] = pixels[:, :, [channel, 1]]
        images.append(Image(seed, seed, "png", cv2.imencode(".png", turned)[1].tobytes()))
    learnt = learn_settings(images, StripeSettings(), ImageLosses())
    assert learnt.laser == laser
    assert learnt.gate.hue is not None
    low, high = learnt.gate.hue
    assert (hue - low) % 360 < (high - low) % 360 < 90
    detector = StripeDetector(learnt)
    assert all(len(detector.detect(decode(image), 0).row) > 0.99 * HEIGHT for image in images)


def test_a_mono_camera_needs_no_gate() -> None:
    """One image is enough to see that."""
    grey = synthetic(CONDITIONS[1], 0)[0][:, :, 1]
    image = Image(0, 0, "png", cv2.imencode(".png", grey)[1].tobytes())
    assert learn_settings([image], StripeSettings(), ImageLosses()).laser == "mono"


def test_images_without_a_stripe_teach_nothing() -> None:
    """One line says what to give instead."""
    dark = Image(0, 0, "png", cv2.imencode(".png", np.zeros((HEIGHT, 768, 3), np.uint8))[1].tobytes())
    with pytest.raises(GarbiError, match="no stripe to learn from"):
        learn_settings([dark], StripeSettings(), ImageLosses())


def test_nothing_to_do_is_wrong_usage(log: Path) -> None:
    """Exit status 2."""
    status, output = run(log)
    assert status == 2
    assert "nothing to do" in output


def test_a_log_without_images_ends_in_one_line(tmp_path: Path) -> None:
    """And writes nothing."""
    with LogWriter(tmp_path / "dive.mcap") as writer:
        writer.write_encoder(START, 0.1)
    status, output = run(tmp_path / "dive.mcap", "-o", tmp_path / "s.parquet")
    assert status == 1
    assert "no images" in output
    assert not (tmp_path / "s.parquet").exists()


def test_a_table_is_written_in_groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """So that memory does not grow with the log."""
    monkeypatch.setattr("garbi_map.stripe.table.GROUP_ROWS", 250)
    row = np.arange(100, dtype=np.int32)
    value = row.astype(np.float32)
    stripes = (Stripe(n, row, value, value, value, row > 5) for n in range(10))
    assert write_stripes(tmp_path / "s.parquet", stripes) == (10, 1000)
    meta = pq.read_metadata(tmp_path / "s.parquet")
    assert (meta.num_row_groups, meta.num_rows) == (4, 1000)
    np.testing.assert_array_equal(pq.read_table(tmp_path / "s.parquet")["stamp_ns"], np.repeat(np.arange(10), 100))
