"""YAML from somebody else costs no more than its length, makes nothing but plain values, and fails in one line."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from behaviours.expectations import parse_plan
from garbi_map.calibrate.files import read_camera_info, read_known
from garbi_map.calibrate.targets import parse_target
from garbi_map.config import load_config
from garbi_map.errors import GarbiError
from garbi_map.plain_yaml import MOST_BYTES, parse_yaml, read_text
from garbi_map.rig import parse_rig

BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join(9 * ['*' + a])}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
HOSTILE = {
    "aliases of aliases": BOMB,
    "merged aliases": "a: &a {x: 1}\nb: &b {<<: [*a, *a]}\nc: {<<: [*b, *b]}",
    "no bottom": "[" * 100_000,
    "a tower of maps": "".join(" " * n + "a:\n" for n in range(500)),
    "an endless number": "a: " + "9" * 100_000,
    "an endless hexadecimal": "a: 0x" + "f" * 100_000,
    "an endless sexagesimal": "a: 1" + ":1" * 50_000,
    "no date": "a: 2001-99-99",
    "python": "!!python/object/apply:os.system ['touch here']",
    "no integer": "!!int x",
    "no time": "!!timestamp x",
    "a list as key": "{[1]: 2}",
    "longer than a file": "a: " + "x" * MOST_BYTES,
    "control characters": "a: \x00",
}
BINARY = bytes(range(128, 256))


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE.keys())
def test_hostile_text_is_refused_everywhere_in_one_line(
    text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rig, target, plan, configuration, camera_info: none of them builds what the text stands for."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file.yaml").write_text(text)
    for read in (
        lambda: parse_rig(text, "rig.yaml"),
        lambda: parse_target(text, "target.yaml"),
        lambda: parse_plan(text, "plan.yaml"),
        lambda: load_config(Path("file.yaml")),
        lambda: read_camera_info(Path("file.yaml")),
        lambda: read_known(Path("file.yaml")),
    ):
        with pytest.raises(GarbiError) as error:
            read()
        assert "\n" not in str(error.value) and len(str(error.value)) < 400
    assert not (tmp_path / "here").exists()


def test_a_file_that_does_not_end_is_not_read_to_its_end(tmp_path: Path) -> None:
    """No more than the limit is read, and what is no text is said to be none."""
    with pytest.raises(GarbiError, match="longer than"):
        parse_yaml(read_text(Path("/dev/zero")), "/dev/zero")
    (tmp_path / "binary").write_bytes(BINARY)
    with pytest.raises(GarbiError, match="not UTF-8"):
        read_text(tmp_path / "binary")


plain = st.recursive(
    st.none() | st.booleans() | st.integers(-(10**9), 10**9) | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=20,
)


@given(plain)
@settings(max_examples=200, deadline=None)
def test_what_is_plain_is_read_as_it_was_written(value: object) -> None:
    """The reader takes nothing away from what YAML can say plainly."""

    class NoAliases(yaml.SafeDumper):
        def ignore_aliases(self, data: object) -> bool:
            return True

    assert parse_yaml(yaml.dump(value, Dumper=NoAliases), "here") == value


@given(st.text(alphabet="ab:-[]{}&*!<>|\n #'\"0x.,?%@`=~", max_size=120))
@settings(max_examples=300, deadline=None)
def test_any_text_is_a_value_or_one_line(text: str) -> None:
    """Nothing but GarbiError comes out."""
    try:
        parse_yaml(text, "here")
    except GarbiError as error:
        assert "\n" not in str(error)
