"""The command line answers at once and says what each command does."""

from __future__ import annotations

import json
import subprocess
import sys

HEAVY = (
    "numpy",
    "scipy",
    "numba",
    "open3d",
    "rerun",
    "rasterio",
    "laspy",
    "filterpy",
    "cv2",
    "kiss_icp",
    "pyarrow",
    "pydantic",
    "mcap",
)

PROGRAM = """
import json, sys
sys.argv = ["garbi", "--help"]
from garbi_map.cli import main
from garbi_map.cli.app import app
try:
    main()
except SystemExit as end:
    assert not end.code
commands = {command.name: command.help or (command.callback.__doc__ or "") for command in app.registered_commands}
print(json.dumps([sorted(sys.modules), commands]), file=sys.stderr)
"""


def test_help_imports_nothing_heavy_and_every_command_has_help() -> None:
    """After `garbi --help` no room with numbers in it is loaded; each registered command says what it is for."""
    ended = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True)
    modules, commands = json.loads(ended.stderr)
    assert not [name for name in HEAVY if name in modules]
    assert {"map", "sweep", "check", "evaluate"} <= set(commands)
    for name, text in commands.items():
        assert len(text.strip()) > 10, name
        assert name in ended.stdout
