"""python -m tools.bench.mutants [-o FILE]: the rules that keep the vehicle safe, broken one at a time: does a test fail?

Each is broken in a copy of the sources; exit status 1 where one was broken and no test noticed."""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
COPIED = ("behaviours", "garbi_map", "tools", "tests", "pyproject.toml")


@dataclass(frozen=True)
class Mutant:
    """A rule, the file that it is in, what stands there, what is put in its place, and the tests that ought to fail."""

    rule: str
    file: str
    right: str
    wrong: str
    tests: str


MUTANTS = (
    Mutant(
        "barrier: any speed at any distance", "behaviours/safety.py",
        "        if margin <= 0.0:\n            return 0.0\n", "        if margin <= 9.0:\n            return 9.0\n",
        "safety",
    ),
    Mutant(
        "age limit: every view is fresh", "behaviours/safety.py",
        "        braking = vehicle.reaction",
        "        corridor = Corridor(corridor.length, 0.0, corridor.end)\n        braking = vehicle.reaction", "safety",
    ),
    Mutant(
        "age limit: no fading before it", "behaviours/safety.py",
        "fade = min(1.0, (settings.stale - corridor.age) / (settings.stale - settings.fresh))", "fade = 1.0", "safety",
    ),
    Mutant(
        "unknown rule: the filter takes the unseen for free", "behaviours/safety.py",
        "            if unknown:\n", "            if unknown:\n                continue\n", "safety",
    ),
    Mutant(
        "unknown rule: the volume does not tell where the unseen begins", "behaviours/kernels.py",
        "                if kind == FREE:\n                    continue\n                px",
        "                if kind != OCCUPIED:\n                    continue\n                px", "space",
    ),
    Mutant(
        "leeway: no escape is ever needed", "behaviours/leeway.py",
        "        if not dares and room.max() >= (", "        if not dares and room.max() >= -9.0 * (", "leeway",
    ),
    Mutant(
        "leeway: the water stands still in the rehearsal", "behaviours/leeway.py",
        "        escapes = self._escapes(current, fastest)\n",
        "        current = 0.0 * current\n        escapes = self._escapes(current, fastest)\n", "leeway",
    ),
    Mutant(
        "leeway: an old view stops it come what may", "behaviours/leeway.py",
        "if room.max() < HOPELESS and fastest < bold:", "if False:", "leeway",
    ),
    Mutant(
        "leeway: an old view never bounds it", "behaviours/leeway.py",
        "if room.max() < HOPELESS and fastest < bold:", "if fastest < bold:", "leeway",
    ),
    Mutant(
        "leeway: the unseen is free", "behaviours/leeway.py", "enough - found[:, 1]", "enough + 0.0 * found[:, 1]", "leeway",
    ),
    Mutant(
        "re-arm rule: never armed", "behaviours/stabilisation.py",
        "            self.rearm(pose)", "            pass", "hold",
    ),
    Mutant(
        "re-arm rule: armed once only", "behaviours/stabilisation.py",
        "self._asked_ns is None or not 0 <= now - self._asked_ns <= PAUSE_NS", "self._asked_ns is None", "hold",
    ),
    Mutant(
        "retreat: never", "behaviours/retreat.py", "if self._blocked < PATIENCE:", "if True:", "retreat",
    ),
    Mutant(
        "escape: up out of sight of the ground", "behaviours/escape.py", "worth -= BLIND", "worth -= 0.0", "retreat",
    ),
    Mutant(
        "escape: the unseen is never dared", "behaviours/escape.py",
        "if gap < (HOPEFUL if dared else HOPELESS):", "if False:", "escape",
    ),
    Mutant(
        "escape: half way through the unseen it is shunned again", "behaviours/escape.py",
        "        dared, self._dares = self._dares, False\n", "        dared = self._dares = False\n", "escape",
    ),
    Mutant(
        "escape: what was seen is dared too", "behaviours/kernels_escape.py",
        "if now > barred:", "if now > barred and not dare:", "escape",
    ),
    Mutant(
        "escape: the filter shuns the unseen all the same", "behaviours/pilot.py",
        "situation.nearby.hit() if dares", "situation.nearby if dares", "escape",
    ),
    Mutant(
        "escape: what dares is not kept from what was seen", "behaviours/space.py",
        "        kept = ~self.unknown\n", "        kept = self.unknown & ~self.unknown\n", "escape",
    ),
)  # fmt: skip


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.bench.mutants", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, help="JSON: which test failed for which rule")
    output = parser.parse_args().output
    found = {}
    for mutant in MUTANTS:
        found[mutant.rule] = noticed(mutant)
        print(f"{mutant.rule}: {found[mutant.rule] or 'NOTICED BY NO TEST'}", flush=True)
    if output:
        output.write_text(json.dumps(found, indent=1) + "\n")
    return 0 if all(found.values()) else 1


def noticed(mutant: Mutant) -> str:
    """The first test that fails with that rule broken; nothing where none does."""
    with tempfile.TemporaryDirectory() as folder:
        for name in COPIED:
            source = ROOT / name
            if source.is_dir():
                shutil.copytree(source, Path(folder) / name, ignore=shutil.ignore_patterns("__pycache__", "results"))
            else:
                shutil.copy(source, folder)
        path = Path(folder) / mutant.file
        text = path.read_text()
        if mutant.right not in text:
            raise SystemExit(
                f"{mutant.file} no longer reads as the mutant '{mutant.rule}' expects: adapt tools/bench/mutants.py"
            )
        path.write_text(text.replace(mutant.right, mutant.wrong, 1))
        command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider"]
        command.append(f"tests/test_behaviours_{mutant.tests}.py")
        said = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False).stdout
    failed = [line for line in said.splitlines() if line.startswith("FAILED")]
    return failed[0].split("::")[1].split(" - ")[0] if failed else ""


if __name__ == "__main__":
    sys.exit(main())
