"""What several tests need."""

from __future__ import annotations

from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of independent dives and real images that may lie beside the checkout; it is not part of the project."""
    for parent in Path(__file__).resolve().parents:
        if (parent / "shared" / "data").is_dir():
            return parent / "shared"
    pytest.skip("the folder `shared` with independent data is not beside this checkout")
