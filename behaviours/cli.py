"""`garbi replay`"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from garbi_map.cli.app import app

if TYPE_CHECKING:
    from behaviours.decisions import Decision


@app.command("replay")
def replay(
    logs: Annotated[
        list[Path],
        typer.Argument(help="MCAP files, rosbag2 directories, or folders of logs, each a test.", show_default=False),
    ],
    behaviours: Annotated[
        Path | None, typer.Option(help="Behaviours and expectations, YAML; wins over those that the log carries.")
    ] = None,
    output: Annotated[Path | None, typer.Option("--output", "-o", help="Decisions, .mcap; one log only.")] = None,
    rig: Annotated[Path | None, typer.Option(help="Rig file, instead of the one in the log.")] = None,
    config: Annotated[Path | None, typer.Option(help="Configuration, YAML.")] = None,
    workers: Annotated[int, typer.Option(min=1, help="Threads that decode images and find stripes.")] = 2,
    view: Annotated[
        bool, typer.Option("--view", help="Watch the decisions in Rerun as they are made; one log.")
    ] = False,
) -> None:
    """Run behaviours on a log, deterministic and explained (exit 0: expectations held, 4: failed, 5: no encounter)."""
    from behaviours.expectations import load_plan
    from behaviours.replay import plan_of
    from behaviours.replay import replay as run
    from garbi_map.config import load_config
    from garbi_map.errors import GarbiError
    from garbi_map.log import open_log
    from garbi_map.rig import load_rig

    given = None if behaviours is None else load_plan(behaviours)
    settings = load_config(config)
    paths = [found for path in logs for found in _tests_in(path, given is not None)]
    if not paths:
        raise GarbiError(f"{logs[0]}: no log in it carries expectations")
    if output is not None and len(paths) > 1:
        raise GarbiError("--output takes the decisions of one log; give one log")
    if view and len(paths) > 1:
        raise GarbiError("--view shows the decisions of one log; give one log")
    worst = 0
    for path in paths:
        log = open_log([path], settings.log)
        plan, mounted = plan_of(log, given), load_rig(rig) if rig else None
        with _watched(path, view) as show:
            done = run(log, plan, settings, output, mounted, workers, show)
        typer.echo(f"{path}: {done.decisions} decisions over {done.seconds:.1f} s")
        for name, state, words in done.verdicts:
            typer.echo(f"  {state:12} {name}: {words}")
        for line in done.losses:
            typer.echo(f"left out: {line}", err=True)
        worst = 4 if 4 in (worst, done.status) else max(worst, done.status)
    if worst:
        raise typer.Exit(worst)


@contextmanager
def _watched(path: Path, view: bool) -> Iterator[Callable[[Decision], None]]:
    """What to do with each decision: nothing, or to show it."""
    if not view:
        yield lambda _: None
        return
    from behaviours.live import DecisionSender
    from garbi_map.view.blueprint import decision_blueprint
    from garbi_map.view.live import live

    with live(path.stem, decision_blueprint, DecisionSender) as shown:
        yield shown.show


def _tests_in(path: Path, any_log: bool) -> list[Path]:
    """A log itself, or the logs of a folder: those that carry expectations, unless expectations were given."""
    from behaviours.replay import RECORD
    from garbi_map.log import open_log

    if not path.is_dir() or (path / "metadata.yaml").exists():
        return [path]
    found = sorted(path.glob("*.mcap"))
    return [one for one in found if any_log or RECORD in open_log([one]).metadata]
