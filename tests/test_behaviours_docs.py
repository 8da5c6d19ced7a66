"""What docs/behaviours.md says is so."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

from behaviours import decisions
from behaviours.expectations import AnyExpectation, parse_plan
from behaviours.settings import BehaviourSettings

PAGE = (Path(__file__).parents[1] / "docs/behaviours.md").read_text()


def first_column() -> set[str]:
    """All names in backquotes in the first columns of the tables."""
    rows = [line.split("|")[1] for line in PAGE.splitlines() if line.startswith("| `")]
    return {name for row in rows for name in re.findall(r"`([^`]+)`", row)}


def test_the_plan_of_the_page_is_read_as_it_says() -> None:
    """The goal, what does not run, and all five expectations."""
    block = re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    assert block is not None
    plan = parse_plan(block.group(1), "the page")
    assert plan.behaviours.travel is not None and plan.behaviours.travel.goal == (6.0, 0.0, 0.0)
    assert plan.behaviours.hold is None and plan.behaviours.survey is None
    assert [one.kind for one in plan.expectations] == ["stops", "holds", "resumes", "false_stops", "away"]
    assert plan.expectations[2].between == (0.0, 60.0)


def test_every_section_expectation_and_topic_is_told() -> None:
    """And none that does not exist."""
    kinds = {get_args(one.model_fields["kind"].annotation)[0] for one in get_args(get_args(AnyExpectation)[0])}
    topics = {decisions.COMMAND, decisions.DECISIONS, decisions.VERDICT, decisions.SAFE_SET, decisions.VOLUME}
    assert first_column() == set(BehaviourSettings.model_fields) | kinds | topics
