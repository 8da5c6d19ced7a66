"""Everything that reads what somebody else wrote gives a result or its own kind of error, whatever it is given.

`python -m tools.bench.fuzz` gives the same parsers a million inputs.
"""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from garbi_map.errors import GarbiError
from tools.bench.fuzz import Parser, make, parsers

NAMES = (
    "log",
    "garbi recover",
    "chunk",
    "image file",
    "rig.yaml",
    "target.yaml",
    "behaviours and expectations",
    "configuration",
    "recorder's lines",
    "camera_info",
    "topics suggested",
    "table",
    "mounts.yaml",
    "message JointState",
    "message Imu",
    "message FluidPressure",
    "message TwistWithCovarianceStamped",
    "message NavSatFix",
    "message PoseWithCovarianceStamped",
    "message Odometry",
    "message CompressedImage",
    "message Image",
)


@pytest.fixture(scope="module")
def all_parsers(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Parser]:
    """Every parser by its name."""
    return {parser.name: parser for parser in parsers(tmp_path_factory.mktemp("fuzz"))}


def test_every_parser_is_tried(all_parsers: dict[str, Parser]) -> None:
    """The list here is that of the bench."""
    assert sorted(all_parsers) == sorted(NAMES)


@pytest.mark.parametrize("name", NAMES)
def test_valid_input_is_taken(name: str, all_parsers: dict[str, Parser]) -> None:
    """What is changed at random began as something that is read."""
    for valid in all_parsers[name].valid:
        all_parsers[name].read(valid)


@pytest.mark.parametrize("name", NAMES)
@given(seed=st.integers(0, 1 << 60))
@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_nothing_but_its_own_error(name: str, seed: int, all_parsers: dict[str, Parser]) -> None:
    """Noise, changed input, and nonsense under sound checksums; a user's error is one line."""
    parser = all_parsers[name]
    try:
        parser.read(make(parser, np.random.default_rng(seed)))
    except parser.errors as error:
        assert not (isinstance(error, GarbiError) and "\n" in str(error))
