"""Coordination, expectations, and replays of the logs that come with the project."""

from __future__ import annotations

import importlib
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from behaviours.coordinator import coordinate
from behaviours.decisions import Decision
from behaviours.expectations import exit_status, parse_plan
from behaviours.feed import Seen
from behaviours.pilot import Pilot
from behaviours.settings import BehaviourSettings
from behaviours.situation import Situation
from behaviours.types import AXES, Command, Proposal
from garbi_map.errors import GarbiError
from tests.behaviour_parts import MOUNT, START, pose, profile, rig, wall

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


def moments(text: str, near: list[float], surge: list[float]) -> list[tuple[float, float, bool]]:
    """When the one expectation of a plan was met and when not, s to the tenth."""
    plan = parse_plan(f"expectations: [{text}]", "test")
    return [(round(begin, 1), round(end, 1), met) for begin, end, met in plan.moments(series(near, surge))[0]]


def test_an_expectation_is_met_and_missed_at_the_moments_it_speaks_of() -> None:
    """Something is near from 1 to 6 s: the vehicle stands from 1.2 s on, but for 3.0 to 3.3 s, and goes on at 7.2 s."""
    near = [np.inf] * 10 + [0.8] * 50 + [np.inf] * 60
    surge = [0.2] * 12 + [0.0] * 18 + [0.2] * 3 + [0.0] * 39 + [0.2] * 48
    assert moments("stops: {within: 0.6}", near, surge) == [(1.0, 1.3, True)]
    assert moments("holds: {after: 0.6}", near, surge) == [(1.6, 3.0, True), (3.0, 3.3, False), (3.3, 6.0, True)]
    assert moments("resumes: {within: 3}", near, surge) == [(5.9, 7.3, True)]
    assert moments("resumes: {within: 1}", near, surge) == [(5.9, 7.3, False)]
    assert moments("false_stops: {settle: 0.5}", near, surge) == [
        (0.6, 1.0, True), (6.4, 7.2, False), (7.2, 11.9, True)
    ]  # fmt: skip
    assert moments("stops: {between: [8, 9]}", near, surge) == []
    assert moments("says: {text: nothing like it}", near, surge) == []


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


PLAN = """\
behaviours: {travel: null, hold: {target: cylinder, range: 1.5}}
expectations: [target: {between: [8, 24]}, says: {text: never said}]
"""


@pytest.fixture(scope="module")
def decided(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, int, str]:
    """The pipe's log replayed with one thread and a plan of which one line cannot hold: plan, decisions, exit status,
    what was printed."""
    folder = tmp_path_factory.mktemp("replay")
    plan, out = folder / "plan.yaml", folder / "decisions.mcap"
    plan.write_text(PLAN)
    return plan, out, *run(LOGS / "behaviour_pipe.mcap", "--behaviours", plan, "-o", out, "--workers", 1)


def test_the_same_log_makes_the_same_bytes_whatever_the_threads(
    decided: tuple[Path, Path, int, str], tmp_path: Path
) -> None:
    """Twice, with one thread and with three."""
    plan, out, _, _ = decided
    run(LOGS / "behaviour_pipe.mcap", "--behaviours", plan, "-o", tmp_path / "again.mcap", "--workers", 3)
    assert (tmp_path / "again.mcap").read_bytes() == out.read_bytes()


def test_a_failed_expectation_is_exit_status_four(decided: tuple[Path, Path, int, str]) -> None:
    """A plan on the command line wins over the log's own."""
    _, _, status, output = decided
    assert status == 4 and "held         target" in output and "failed       says" in output


def test_decisions_are_standard_messages_that_explain_themselves(decided: tuple[Path, Path, int, str]) -> None:
    """A diagnostic array per tick with every behaviour, the coordinator and safety; a twist; a verdict at the end."""
    from mcap.reader import make_reader
    from rosbags.typesys import Stores, get_typestore

    types = get_typestore(Stores.ROS2_HUMBLE)
    found: dict[str, list] = {}
    with decided[1].open("rb") as file:
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


def test_a_rig_that_looks_straight_down_moves_on_a_stated_prior_only() -> None:
    """The survey leg's log, with its prior and without: slowly, or not at all; both times it says why."""
    from behaviours.log_feed import LogFeed
    from behaviours.replay import decide_all, plan_of
    from garbi_map.config import Config
    from garbi_map.log import open_log

    log = open_log([LOGS / "behaviour_survey_leg.mcap"])
    plan = plan_of(log, None)
    for prior, words in ((plan.behaviours.prior, "the stated prior's speed"), (None, "no prior is stated")):
        told = plan.model_copy(update={"behaviours": plan.behaviours.model_copy(update={"prior": prior})})
        feed = LogFeed(log, told.behaviours.feed, Config().stripe, workers=1)
        decisions = list(islice(decide_all(feed, told), 120))[85:]  # it looks first
        surges = [one.command.surge for one in decisions]
        assert max(surges) == pytest.approx(prior.speed if prior else 0.0)
        assert all(words in one.text() for one in decisions)


@given(
    st.lists(
        st.tuples(
            SHARE, st.integers(0, 3), st.tuples(*[st.floats(-1, 1)] * 4), st.sets(st.sampled_from(AXES)), st.booleans()
        ),
        max_size=5,
    )
)
def test_coordination_never_invents(given_: list) -> None:
    """On every axis the command lies within what those who care for it, and have not expired, ask for; else it is nought."""
    proposals = [
        Proposal(f"b{n}", share, Command.of(np.array(values)), "", priority, tuple(axes), 0 if gone else 10)
        for n, (share, priority, values, axes, gone) in enumerate(given_)
    ]
    got = coordinate(proposals, 5).command.array()
    for number, axis in enumerate(AXES):
        asked = [
            one.command.array()[number]
            for one in proposals
            if axis in one.axes and one.expires_ns > 5 and one.activation > 0
        ] or [0.0]
        assert min(asked) - 1e-9 <= got[number] <= max(asked) + 1e-9


@given(st.tuples(*[st.floats(-2, 2)] * 4))
@settings(max_examples=25, deadline=None)
def test_safety_has_the_last_word_whatever_is_proposed(wanted: tuple) -> None:
    """Any behaviour, at any priority: the command that leaves the pilot is one that safety leaves as it is."""
    at = pose(1.0)

    class Any:
        name = "any"

        def propose(self, situation: Situation) -> Proposal:
            return Proposal("any", 1.0, Command.of(np.array(wanted)), "whatever", 10**6)

    pilot = Pilot(BehaviourSettings(), rig(), MOUNT)
    pilot.behaviours.append(Any())
    one = profile(wall(1.6), at)
    decision = pilot.decide(Seen(at.stamp_ns, at, [one] * 3))
    assert decision.winner == "any" and decision.merged.array() == pytest.approx(np.array(wanted))
    situation = pilot._situation(Seen(at.stamp_ns, at), at)
    again = pilot.safety.filter(
        decision.command, at, situation.nearby, situation.corridor, situation.movers, situation.troubles
    )
    assert again.command.array() == pytest.approx(decision.command.array(), abs=2e-3)
