"""The decisions of a replay as they are shown: what the log says is what is drawn."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from behaviours.decisions import Decision, DecisionWriter
from behaviours.live import DecisionSender, tick_of
from behaviours.moving import Mover
from behaviours.types import Command, Pose, Proposal
from garbi_map.log import open_log
from garbi_map.view import style
from garbi_map.view.blueprint import decision_blueprint
from garbi_map.view.decisions import Said, moments_of, read_ticks
from garbi_map.view.safe_set import AHEAD, START, clipped, outlines
from garbi_map.view.show import Wishes, save_log
from garbi_map.view.stream import recording_file
from tests.view_scene import recorded

BEGIN, PERIOD = 1_790_000_000_000_000_000, 100_000_000
TICKS = 30


def decision(number: int) -> Decision:
    """A vehicle that travels; from the tenth tick on something moves ahead, and avoidance takes over."""
    now = BEGIN + number * PERIOD
    near = number >= 10
    pose = Pose(now, np.array([0.02 * number, 0.0, -5.0]), np.eye(3), np.array([0.2, 0.0, 0.0]), np.zeros(3))
    mover = Mover(1, now, now, np.array([1.5, 0.2, -5.0]), np.array([0.0, -0.1, 0.0]), 0.2, 3)
    box = np.c_[np.r_[np.eye(4), -np.eye(4)], [0.3, 0.15, 0.35, 0.2, 0.2, 0.15, 0.35, 0.2]]
    return Decision(
        now,
        pose,
        [
            Proposal(
                "avoidance", 1.0 if near else 0.0, Command(-0.1), "something near" if near else "nothing near", 100
            ),
            Proposal("travel", 1.0, Command(0.2), "straight on", 10),
        ],
        Command(-0.1 if near else 0.2),
        "avoidance" if near else "travel",
        "one of them",
        Command(-0.1 if near else 0.15),
        [] if near else ["surge 0.20 -> 0.15 m/s: the view is old"],
        False,
        [],
        1.0,
        "free 2.0 m ahead",
        [mover] if near else [],
        box,
        (np.array([[1.0, 0.0, -5.5], [1.1, 0.0, -5.5]]), np.array([[1.0, 0.0, -5.0]])) if number % 10 == 0 else None,
    )


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("decisions") / "decisions.mcap"
    with DecisionWriter(path) as writer:
        plan = '{"expectations": [{"kind": "stops", "between": [1.0, 2.0]}, {"kind": "resumes", "between": null}]}'
        writer.write_metadata("garbi.behaviours", {"json": plan})
        for number in range(TICKS):
            writer.write(decision(number))
        verdicts = [
            ("stops", "held", "in time"),
            ("resumes", "no encounter", "nothing cleared"),
            ("away", "failed", "not always"),
        ]
        writer.write_verdict(BEGIN + (TICKS - 1) * PERIOD, verdicts, [[], [], [(1.0, 1.4, True), (1.4, 2.0, False)]])
    return path


@pytest.fixture(scope="module")
def content(log: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, list]]:
    out = tmp_path_factory.mktemp("seen") / "decisions.rrd"
    assert save_log(log, Wishes(), out) == []
    return recorded(out)


def rows(content: dict[str, dict[str, list]], path: str, column: str) -> list:
    return [row for row in content[path][column] if row is not None]


def changes(content: dict[str, dict[str, list]], lane: str) -> list[tuple[int, str]]:
    """(tick, state) of a lane."""
    lanes = content[f"{style.LANES}/{lane}"]
    found = zip(lanes["stamp"], lanes["StateChange:state"], strict=True)
    return [((stamp - BEGIN) // PERIOD, state[0]) for stamp, state in found if state is not None]


def test_arrows_end_where_the_bow_would_be(content: dict) -> None:
    """A surge of 0.2 m/s is an arrow of one metre: five seconds; a behaviour that is silent has none."""
    travel = rows(content, style.proposal("travel").path, "Arrows3D:vectors")
    np.testing.assert_allclose(np.array(travel)[:, 0], np.tile([0.2 * AHEAD, 0.0, 0.0], (TICKS, 1)), atol=1e-6)
    avoidance = rows(content, style.proposal("avoidance").path, "Arrows3D:vectors")
    assert [len(arrow) for arrow in avoidance] == [0] * 10 + [1] * 20


def test_bands_say_who_leads(content: dict) -> None:
    """Travel leads until avoidance takes over; safety changes the command until then."""
    assert changes(content, "travel") == [(0, style.LEADS), (10, style.ACTS), (29, "")]
    assert changes(content, "avoidance") == [(0, ""), (10, style.LEADS), (29, "")]
    assert changes(content, "safety") == [(0, style.CHANGES), (10, "")]


def test_expectations_lie_where_they_speak(content: dict) -> None:
    """One over the seconds that its plan names, one over the whole log."""
    assert changes(content, "expected/stops") == [(10, "held"), (20, "")]
    assert changes(content, "expected/resumes") == [(0, "no encounter"), (29, "")]


def test_expectations_are_met_and_missed_when_they_are(content: dict) -> None:
    """Met from the tenth tick, missed from the fourteenth to the twentieth."""
    assert changes(content, "expected/away") == [(10, style.MET), (14, ""), (14, style.MISSED), (20, "")]


@given(st.text() | st.recursive(st.none() | st.booleans() | st.floats() | st.text(), st.lists).map(json.dumps))
def test_moments_that_make_no_sense_are_no_moments(text: str) -> None:
    """Whatever a log says of them; what is taken is in order, and within a lifetime."""
    for begin, end, _ in moments_of(Said(0, "", {"moments": text})) or []:
        assert 0.0 <= begin <= end < 1e9


def test_the_reason_is_there_in_words(content: dict) -> None:
    """A page for each change, and a line where safety stepped in."""
    pages = [row[0] for row in rows(content, style.WORDS, "TextDocument:text")]
    assert "nothing near" in pages[0] and "the view is old" in pages[0]
    assert "something near" in pages[-1] and "moving" not in pages[0]
    assert rows(content, style.LOSSES, "TextLog:text") == [["surge 0.20 -> 0.15 m/s: the view is old"]]


def test_the_volume_and_what_moves_are_where_they_were(content: dict) -> None:
    """Blocks and balls in the frame of the decisions."""
    blocks = rows(content, style.OCCUPIED.path, "Boxes3D:centers")
    assert len(blocks) == TICKS // 10
    np.testing.assert_allclose(blocks[0], [[1.0, 0.0, -5.5], [1.1, 0.0, -5.5]], atol=1e-6)
    things = rows(content, style.MOVING.path, "Ellipsoids3D:centers")
    assert len(things) == 20
    np.testing.assert_allclose(things[0], [[1.5, 0.2, -5.0]], atol=1e-3)


def test_a_decision_is_shown_alike_live_and_from_its_log(log: Path) -> None:
    """What the live view gets is what the log gives back."""
    for number, tick in enumerate(read_ticks(open_log([log]))):
        own = tick_of(decision(number))
        assert own.parts == tick.parts
        np.testing.assert_allclose(own.position, tick.position)
        np.testing.assert_allclose(own.allowed, tick.allowed)
        assert (own.volume is None) == (tick.volume is None)


def test_a_live_decision_draws_what_a_log_draws(content: dict, tmp_path: Path) -> None:
    """The same entities, one tick at a time."""
    sender = DecisionSender()
    with recording_file(tmp_path / "live.rrd", "decisions", "live", decision_blueprint()) as recording:
        for number in range(TICKS):
            sender(recording, decision(number))
    drawn = recorded(tmp_path / "live.rrd")
    assert {path for path in content if path.startswith("map/")} == {path for path in drawn if path.startswith("map/")}


def test_the_safe_set_of_a_box_is_the_box() -> None:
    """Surge -0.2 to 0.3 and heave -0.15 to 0.15 m/s: a rectangle of 5 s before the bow."""
    box = np.c_[np.r_[np.eye(4), -np.eye(4)], [0.3, 0.15, 0.35, 0.2, 0.2, 0.15, 0.35, 0.2]]
    _, standing = outlines(box, np.zeros(4))
    low, high = standing.min(axis=0) - START, standing.max(axis=0) - START
    np.testing.assert_allclose([low, high], [[-1.0, 0.0, -0.75], [1.5, 0.0, 0.75]], atol=1e-6)


@given(
    st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(-0.5, 1)), max_size=8),
    st.tuples(st.floats(-1, 1), st.floats(-1, 1)),
)
def test_what_is_clipped_satisfies_every_constraint(rows: list[tuple], point: tuple[float, float]) -> None:
    """All corners do, and a point that does is inside the corners."""
    planes = np.array(rows, float).reshape(-1, 3)
    corners = clipped(planes)
    assert (corners @ planes[:, :2].T <= planes[:, 2] + 1e-6).all()
    if (planes[:, :2] @ point <= planes[:, 2] - 1e-3).all():
        assert len(corners) >= 3
        step = np.roll(corners, -1, axis=0) - corners
        to_point = np.array(point) - corners
        assert (step[:, 0] * to_point[:, 1] - step[:, 1] * to_point[:, 0] >= -1e-6).all()
