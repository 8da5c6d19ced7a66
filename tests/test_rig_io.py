"""rig.yaml in and out."""

from __future__ import annotations

import copy
from dataclasses import replace

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from rigs import TILTED_WINDOW, make_rig

from garbi_map.errors import GarbiError
from garbi_map.rig import load_rig, parse_rig

GOOD = yaml.safe_load(make_rig(TILTED_WINDOW).to_yaml())


def changed(path: str, value: object) -> str:
    """The good file with one key set, or taken away where the value is Ellipsis."""
    document = copy.deepcopy(GOOD)
    *sections, key = path.split(".")
    section = document
    for name in sections:
        section = section[name]
    if value is ...:
        del section[key]
    else:
        section[key] = value
    return yaml.safe_dump(document)


@pytest.mark.parametrize("port", [None, TILTED_WINDOW])
def test_a_rig_survives_its_file(port):
    """What is written is read, to the last bit."""
    rig = make_rig(port)
    again = parse_rig(rig.to_yaml(), "rig.yaml")
    assert again == rig
    assert again.to_yaml() == rig.to_yaml()


def test_unknown_keys_are_kept():
    """Covariances, dates and the like are carried along at every level; computed values win."""
    document = copy.deepcopy(GOOD)
    document["date"] = "2026-11-20"
    document["laser"]["covariance"] = [[1e-6, 0.0], [0.0, 1e-6]]
    document["camera"]["intrinsics"]["sigma"] = 0.2
    rig = parse_rig(yaml.safe_dump(document), "rig.yaml")
    assert yaml.safe_load(rig.to_yaml()) == document


def test_a_removed_port_stays_removed():
    """A rig that was read with a port and lost it is written without."""
    rig = parse_rig(yaml.safe_dump(GOOD), "rig.yaml")
    bare = replace(rig, camera=replace(rig.camera, port=None))
    assert parse_rig(bare.to_yaml(), "rig.yaml") == bare


def test_a_fixed_angle_is_read():
    """A scanner without a motor says at which angle its sheet stands."""
    assert parse_rig(changed("laser.fixed_angle", 0.31), "rig.yaml").laser.fixed_angle == 0.31
    assert make_rig().laser.fixed_angle is None


def test_numbers_in_the_short_form_are_numbers():
    """YAML 1.1 takes 2e-2 for text; a person means a number."""
    assert parse_rig(yaml.safe_dump(GOOD).replace("beta: 0.0285", "beta: 2e-2"), "rig.yaml").laser.beta == 0.02


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("camera", ...),
        ("laser", None),
        ("camera.image_width", ...),
        ("camera.image_height", 0),
        ("camera.image_width", 768.5),
        ("camera.distortion_model", "equidistant"),
        ("camera.intrinsics", [812.0, 815.0]),
        ("camera.intrinsics.alpha_u", -812.0),
        ("camera.intrinsics.alpha_v", 0),
        ("camera.intrinsics.u0", float("nan")),
        ("camera.intrinsics.v0", True),
        ("camera.distortion", [0.1, 0.2]),
        ("camera.distortion", [-0.1, 0.0, 0.0, "x", 0.0]),
        ("camera.distortion", [-2.0, 0.0, 0.0, 0.0, 0.0]),
        ("camera.pose_in_rig.xyz", ...),
        ("camera.pose_in_rig.quaternion_xyzw", [1.0, 1.0, 0.0, 0.0]),
        ("camera.pose_in_rig.quaternion_xyzw", [0.0, 0.0, 0.0, 0.0]),
        ("camera.port.kind", "dome"),
        ("camera.port.normal", [0.0, 0.0, -1.0]),
        ("camera.port.index_glass", 0.9),
        ("camera.port.index_water", float("inf")),
        ("camera.port.distance", 0.0),
        ("camera.port.thickness", -0.01),
        ("laser.joint", 3),
        ("laser.x", "left"),
        ("laser.y", 400.0),
        ("laser.beta", 2.0),
        ("laser.theta", ...),
        ("laser.fixed_angle", "none"),
    ],
)
def test_an_absurd_or_missing_value_is_named(key, value):
    """One line with the file, the key, and what was expected."""
    with pytest.raises(GarbiError) as caught:
        parse_rig(changed(key, value), "dive/rig.yaml")
    message = str(caught.value)
    assert message.startswith("dive/rig.yaml: ")
    assert key in message
    assert "expected" in message
    assert "\n" not in message


def test_a_quaternion_nearly_unit_is_made_unit():
    """Four decimals are common and forgiven."""
    rig = parse_rig(changed("camera.pose_in_rig.quaternion_xyzw", [-0.5002, 0.5, -0.5, 0.5]), "rig.yaml")
    assert sum(q * q for q in rig.camera.quaternion) == pytest.approx(1.0, abs=1e-15)


@given(st.text(max_size=60) | st.binary(max_size=60).map(lambda raw: raw.decode("latin-1")))
def test_any_text_is_refused_in_one_line(text):
    """Nothing that is not a rig ends in anything but a GarbiError."""
    with pytest.raises(GarbiError):
        parse_rig(text, "rig.yaml")


def test_code_in_yaml_is_not_run():
    """Only plain YAML is read."""
    with pytest.raises(GarbiError, match="not YAML"):
        parse_rig("camera: !!python/object/apply:os.getcwd []", "rig.yaml")


def test_a_file_that_is_not_there_is_named(tmp_path):
    """The path and the reason."""
    with pytest.raises(GarbiError, match=r"none\.yaml.*No such file"):
        load_rig(tmp_path / "none.yaml")


def test_the_recorded_dives_rigs_load(shared):
    """The independent dives' rig files are of this format."""
    for dive in ("calm", "drift", "cheap"):
        rig = load_rig(shared / "data" / "dives" / dive / "rig.yaml")
        assert rig.camera.width == 768
        assert rig.camera.port is None
