"""Coordination, expectations, and replays of the logs that come with the project."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from behaviours.coordinator import coordinate
from behaviours.decisions import Decision
from behaviours.expectations import exit_status, parse_plan
from behaviours.types import AXES, Command, Proposal
from garbi_map.errors import GarbiError
from tests.behaviour_parts import START, pose

LOGS = Path(__file__).resolve().parents[1] / "logs"
SHARE = st.just(0.0) | st.floats(0.001, 1)


def test_hybrid_coordination_is_the_published_formula() -> None:
    """a = ad + an (1 - ad), v = (vd ad + vn an (1 - ad)) / a."""
    got = coordinate([Proposal("low", 0.5, Command(0.2), "", 1), Proposal("high", 0.6, Command(-0.1), "", 2)], 0)
    assert got.command.surge == pytest.approx((-0.1 * 0.6 + 0.2 * 0.5 * 0.4) / (0.6 + 0.5 * 0.4))
    assert got.winner == "high"


@given(SHARE, SHARE, st.floats(-1, 1), st.floats(-1, 1))
def test_the_merged_command_lies_between_the_proposals(high: float, low: float, a: float, b: float) -> None:
    """And full activation of the dominant one leaves nothing to the other."""
    proposals = [Proposal("high", high, Command(a), "", 2), Proposal("low", low, Command(b), "", 1)]
    surge = coordinate(proposals, 0).command.surge
    values = [value for value, share in ((a, high), (b, low)) if share > 0] or [0.0]
    assert min(values) - 1e-9 <= surge <= max(values) + 1e-9
    assert coordinate([Proposal("high", 1.0, Command(a), "", 2), proposals[1]], 0).command.surge == pytest.approx(a)


def test_axes_are_decided_apart_and_expired_proposals_do_not_count() -> None:
    """Who does not care for an axis leaves it to the next; what is void is void."""
    high = Proposal("high", 1.0, Command(0.1, 0.1, 0.1, 0.1), "", 2, ("surge",))
    low = Proposal("low", 1.0, Command(0.2, 0.05, 0.3, 0.0), "", 1)
    got = coordinate([high, low], 100).command
    assert (got.surge, got.heave, got.yaw) == pytest.approx((0.1, 0.05, 0.3))
    gone = Proposal("high", 1.0, Command(0.1), "", 2, AXES, expires_ns=99)
    assert coordinate([gone], 100).command == Command() and coordinate([], 100).winner == "none"


def series(obstacle: list[float], surge: list[float], period: float = 0.1) -> list[Decision]:
    """Decisions with these distances and surges."""
    return [
        Decision(
            START + round(n * period * 1e9), pose(n * period), [Proposal("travel", 1.0, Command(0.2), "on")], Command(0.2),
            "travel", "", Command(speed), [], False, [], near, "",
        )
        for n, (near, speed) in enumerate(zip(obstacle, surge, strict=True))
    ]  # fmt: skip


@pytest.mark.parametrize(("delay", "state"), [(3, "held"), (6, "held"), (9, "failed")])
def test_a_stop_counts_from_the_first_profile_that_shows_the_obstacle(delay: int, state: str) -> None:
    """0.6 s is enough, 0.9 s is not."""
    plan = parse_plan("expectations: [stops: {within: 0.6, distance: 1.0}]", "test")
    near = [np.inf] * 20 + [0.9] * 40
    surge = [0.2] * (20 + delay) + [0.0] * (40 - delay)
    assert plan.judge(series(near, surge))[0][1] == state


def test_no_encounter_is_neither_held_nor_failed() -> None:
    """Exit status 5, unless something failed: then 4."""
    plan = parse_plan("expectations: [stops: {}, false_stops: {most: 0.05}]", "test")
    free = plan.judge(series([np.inf] * 200, [0.2] * 200))
    assert [state for _, state, _ in free] == ["no encounter", "held"] and exit_status(free) == 5
    stopping = plan.judge(series([np.inf] * 200, [0.0] * 200))
    assert exit_status(stopping) == 4
    assert exit_status([]) == 0


def test_holding_and_resuming() -> None:
    """Ninety percent of the time near; on again once it is gone."""
    plan = parse_plan("expectations: [holds: {share: 0.9}, resumes: {within: 3}]", "test")
    near = [np.inf] * 10 + [0.8] * 50 + [np.inf] * 60
    good = [0.2] * 12 + [0.0] * 60 + [0.2] * 48
    assert [state for _, state, _ in plan.judge(series(near, good))] == ["held", "held"]
    bad = [0.2] * 30 + [0.0] * 90
    assert [state for _, state, _ in plan.judge(series(near, bad))] == ["failed", "failed"]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("expectations: [jumps: {}]", "expectations.0"),
        ("behaviours: {avoidance: {notise: 1}}", "behaviours.avoidance.notise"),
        ("expectations: [stops: {within: -1}]", "within"),
        ("a: [", "not YAML"),
    ],
)
def test_a_bad_plan_is_named_in_one_line(text: str, words: str) -> None:
    """File, key, and what is wrong."""
    with pytest.raises(GarbiError) as error:
        parse_plan(text, "plan.yaml")
    assert words in str(error.value) and "plan.yaml" in str(error.value) and "\n" not in str(error.value)


def run(*arguments: object) -> tuple[int, str]:
    for name in ("behaviours.cli", "garbi_map.cli.sweep"):  # an application of one command would take no command name
        importlib.import_module(name)
    from garbi_map.cli.app import app

    got = CliRunner().invoke(app, ["replay", *map(str, arguments)])
    return got.exit_code, got.output


@pytest.fixture(scope="module")
def decided(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The decisions on the pipe's log, made with one thread."""
    out = tmp_path_factory.mktemp("replay") / "decisions.mcap"
    assert run(LOGS / "behaviour_pipe.mcap", "-o", out, "--workers", 1)[0] == 0
    return out


def test_the_same_log_makes_the_same_bytes_whatever_the_threads(decided: Path, tmp_path: Path) -> None:
    """Twice, with one thread and with three."""
    assert run(LOGS / "behaviour_pipe.mcap", "-o", tmp_path / "again.mcap", "--workers", 3)[0] == 0
    assert (tmp_path / "again.mcap").read_bytes() == decided.read_bytes()


def test_decisions_are_standard_messages_that_explain_themselves(decided: Path) -> None:
    """A diagnostic array per tick with every behaviour, the coordinator and safety; a twist; a verdict at the end."""
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    found: dict[str, list] = {}
    with decided.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            assert schema is not None
            found.setdefault(channel.topic, []).append(types.deserialize_cdr(message.data, schema.name))
    spoken = {"/behaviours/command", "/behaviours/decisions", "/behaviours/verdict"}
    assert set(found) == spoken | {"/behaviours/safe_set", "/behaviours/volume", "/odometry/filtered", "/tf"}
    assert len(found["/behaviours/command"]) == len(found["/behaviours/decisions"])
    names = [status.name for status in found["/behaviours/decisions"][100].status]
    assert names == ["feed", "behaviour/avoidance", "behaviour/hold", "coordinator", "safety"]
    assert all(status.message for status in found["/behaviours/decisions"][100].status)
    assert all(one.twist.linear.y == 0.0 for one in found["/behaviours/command"])
    assert found["/behaviours/verdict"][-1].status[0].name == "target"


def test_the_logs_of_the_project_are_a_test_suite() -> None:
    """`garbi replay logs/` runs those that carry expectations, and all hold."""
    status, output = run(LOGS)
    assert status == 0, output
    assert output.count("behaviour_") == len(list(LOGS.glob("behaviour_*.mcap")))
    assert "sample.mcap" not in output


def test_a_failed_expectation_is_exit_status_four(tmp_path: Path) -> None:
    """A plan on the command line wins over the log's own."""
    plan = tmp_path / "plan.yaml"
    plan.write_text("expectations: [says: {text: never said}]")
    status, output = run(LOGS / "behaviour_pipe.mcap", "--behaviours", plan)
    assert status == 4 and "failed" in output
