"""What several tests need."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import HealthCheck, settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command line does, before numpy is imported
settings.register_profile("any machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any machine")


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of independent dives and real images that may lie beside the checkout; it is not part of the project."""
    for parent in Path(__file__).resolve().parents:
        if (parent / "shared" / "data").is_dir():
            return parent / "shared"
    pytest.skip("the folder `shared` with independent data is not beside this checkout")


class Ended(NamedTuple):
    """How a command ended: its exit status and what it printed."""

    status: int
    out: str
    err: str


Garbi = Callable[..., Ended]


@pytest.fixture
def garbi(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Garbi:
    """The command line as a user has it, in this process: garbi("map", log, "-o", folder)."""
    from garbi_map.cli import main

    def run(*arguments: object) -> Ended:
        monkeypatch.setattr(sys, "argv", ["garbi", *map(str, arguments)])
        capfd.readouterr()
        try:
            main()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
        else:
            status = 0
        return Ended(status, *capfd.readouterr())

    return run


@pytest.fixture(scope="session")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first eight seconds of the sample log: three sweeps, two turning points of the laser, every sensor."""
    from dive_logs import SAMPLE, rewrite, without

    return rewrite(
        SAMPLE, tmp_path_factory.mktemp("dive") / "dive.mcap", seconds=7.6, change=without("/tf", "/truth/seabed")
    )
