"""Compiles the numba loops once, so that the first map does not wait for it: a map of a second of the sample log."""

from __future__ import annotations

import tempfile
from pathlib import Path

from garbi_map.config import Config
from garbi_map.pipeline import build_map


def main() -> None:
    """Build and throw away."""
    log = Path(__file__).resolve().parents[1] / "logs" / "sample.mcap"
    with tempfile.TemporaryDirectory() as folder:
        build_map([log], Path(folder), Config(), span=(0.0, 6.0))


if __name__ == "__main__":
    main()
