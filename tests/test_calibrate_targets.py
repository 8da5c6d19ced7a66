"""Targets: what target.yaml may say, how they are printed, and how they are found in rendered images."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from rigs import make_rig
from scipy.spatial.transform import Rotation

from garbi_map.calibrate.detect import detect
from garbi_map.calibrate.drawing import write_drawing
from garbi_map.calibrate.targets import load_target, parse_target
from garbi_map.errors import GarbiError
from tools.simulator.target import Booth, Look
from tools.simulator.target_points import TWO_PLANES, target_of

TARGETS = {
    "checkerboard": "kind: checkerboard\ninner_corners: [9, 6]\nsquare: 0.05",
    "charuco": "kind: charuco\nsquares: [10, 7]\nsquare: 0.05\nmarker: 0.037",
    "apriltag": "kind: apriltag\ntags: [5, 4]\ntag: 0.07\ngap: 0.02",
    "two_planes": TWO_PLANES,
}
POSE = {"two_planes": Rotation.from_euler("yx", [-0.8, -0.15])}
CENTRE = {"two_planes": [0.0, 0.0, 0.0]}


def seen(kind: str) -> tuple[np.ndarray, np.ndarray, object]:
    """A rendered image, the true pixels of all points, and the target."""
    rig, target = make_rig(), target_of(TARGETS[kind])
    rotation = POSE.get(kind, Rotation.from_rotvec([0.2, -0.3, 0.1]))
    shift = np.array([0.0, 0.0, 0.95]) - rotation.apply(CENTRE.get(kind, [0.23, 0.17, 0.0]))
    booth = Booth(rig, target, Look(margin=0.02, samples=3))
    image = booth.image(booth.placed(rotation, shift), None, np.random.default_rng(1))
    return image, rig.camera.project(rotation.apply(target.points) + shift), target


@pytest.mark.parametrize("kind", TARGETS)
def test_targets_are_found_to_a_fraction_of_a_pixel(kind):
    """Nearly all points, numbered right, within a tenth of a pixel rms of where they are."""
    image, expected, target = seen(kind)
    view = detect(image, target, kind)
    assert len(view.number) >= 0.95 * len(target.points)
    off = np.linalg.norm(view.pixel - expected[view.number], axis=1)
    assert np.median(off) < 0.1
    assert (off < 0.5).mean() > 0.95


@pytest.mark.parametrize("kind", ["charuco", "apriltag"])
def test_a_mirrored_target_is_named(kind):
    """Markers that only a flipped image shows: one line says so."""
    image, _, target = seen(kind)
    with pytest.raises(GarbiError, match="mirrored"):
        detect(np.ascontiguousarray(image[:, ::-1]), target, "view")


def test_a_mirrored_checkerboard_is_named_where_it_can_be():
    """With two odd numbers of corners the colours tell, if the print is known; any other board looks the same."""
    odd = target_of("kind: checkerboard\ninner_corners: [9, 7]\nsquare: 0.05")
    booth = Booth(make_rig(), odd, Look(margin=0.02, samples=2))
    placed = booth.placed(Rotation.from_rotvec([0.2, -0.3, 0.1]), np.array([-0.2, -0.15, 0.95]))
    image = booth.image(placed, None, np.random.default_rng(1))
    flipped = np.ascontiguousarray(image[:, ::-1])
    known = odd.model_copy(update={"corner_is_black": True})
    assert detect(image, known, "view") is not None
    with pytest.raises(GarbiError, match="mirrored"):
        detect(flipped, known, "view")
    assert detect(flipped, odd, "view") is not None  # as legitimate as its twin with white corners
    image, _, even = seen("checkerboard")
    assert detect(np.ascontiguousarray(image[:, ::-1]), even, "view") is not None


def test_real_boards_with_either_colour_in_the_corner_are_found(shared: Path):
    """A board of 9 by 7 corners whose first square is white, described either way, and one of 7 by 6."""
    import cv2

    for folder, pattern, corners in (
        ("b33boy/chessboard", "*", ("[9, 7]", "[7, 9]")),
        ("etna/calib3", "*.png", ("[7, 6]",)),
    ):
        image = cv2.imread(str(min((shared / "data" / folder).glob(pattern))), cv2.IMREAD_GRAYSCALE)
        for size in corners:
            board = target_of(f"kind: checkerboard\ninner_corners: {size}\nsquare: 0.02")
            assert detect(image, board, folder) is not None


def test_blur_is_measured():
    """A lens four times softer shows as blur."""
    import cv2

    image, _, target = seen("checkerboard")
    sharp = detect(image, target, "sharp").blur
    soft = detect(cv2.GaussianBlur(image, (0, 0), 4.0), target, "soft").blur
    assert sharp < 1.2
    assert soft > 2.5


def test_an_empty_image_shows_no_target():
    """Noise is not a target."""
    noise = np.random.default_rng(1).integers(0, 60, (288, 384), dtype=np.uint8)
    assert all(detect(noise, target_of(text), "noise") is None for text in TARGETS.values())


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("kind: triangle", "kind"),
        ("square: 0.1", "kind"),
        ("[1", "not YAML"),
        ("kind: checkerboard\ninner_corners: [9, 6]\nsquare: -0.1", "square"),
        ("kind: checkerboard\ninner_corners: [9, 6]\nsquare: .inf", "square"),
        ("kind: checkerboard\ninner_corners: [9]\nsquare: 0.1", "inner_corners"),
        ("kind: checkerboard\ninner_corners: [9, 6]\nsquare: 0.1\ncolour: red", "colour"),
        ("kind: charuco\nsquares: [5, 4]\nsquare: 0.04\nmarker: 0.05", "marker"),
        ("kind: charuco\nsquares: [50, 40]\nsquare: 0.04\nmarker: 0.03", "markers are needed"),
        ("kind: charuco\nsquares: [5, 4]\nsquare: 0.04\nmarker: 0.03\ndictionary: DICT_X", "dictionary"),
        ("kind: apriltag\ntags: [6, 6]\ntag: 0.04\ngap: 0.01\nfamily: tag99h9", "family"),
        (TWO_PLANES.replace("u: [0, 0, -1]", "u: [1, 0, 0]"), "20 degrees"),
        (TWO_PLANES.replace("pitch: 0.07", "pitch: 0.04"), "pitch"),
    ],
)
def test_what_is_wrong_with_a_target_is_one_line(text, named):
    """The line names the file and the key."""
    with pytest.raises(GarbiError, match=named) as raised:
        parse_target(text, "board.yaml")
    assert str(raised.value).startswith("board.yaml")
    assert "\n" not in str(raised.value)


def test_a_missing_target_file_is_one_line(tmp_path: Path):
    """As is one that cannot be read."""
    with pytest.raises(GarbiError, match="cannot be read"):
        load_target(tmp_path / "none.yaml")


@pytest.mark.parametrize("kind", TARGETS)
def test_a_printed_target_has_its_true_size(kind, tmp_path: Path):
    """The SVG's rectangles and the PDF's, in mm and points, are those of the target."""
    target = target_of(TARGETS[kind])
    write_drawing(tmp_path / "t.svg", target)
    write_drawing(tmp_path / "t.pdf", target)
    black = np.concatenate([face.black for face in target.faces])
    svg = re.findall(r"h([\d.]+)v([\d.]+)", (tmp_path / "t.svg").read_text())
    np.testing.assert_allclose(np.array(svg, float), 1e3 * black[:, 2:], atol=1e-3)
    pdf = re.findall(rb"([\d.]+) ([\d.]+) re\n", (tmp_path / "t.pdf").read_bytes())
    np.testing.assert_allclose(np.array(pdf, float) / 72 * 0.0254, black[:, 2:], atol=1e-5)


def test_a_drawing_is_svg_or_pdf(tmp_path: Path):
    """Nothing else is written."""
    with pytest.raises(GarbiError, match=r"\.pdf or \.svg"):
        write_drawing(tmp_path / "t.png", target_of())
    assert not list(tmp_path.iterdir())
