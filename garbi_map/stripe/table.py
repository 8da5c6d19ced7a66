"""Stripes as a Parquet table."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.stripe.types import Stripe

GROUP_ROWS = 250_000
"""Rows of the table that are held before they are written: bounds the memory."""


def write_stripes(path: Path, stripes: Iterable[Stripe]) -> tuple[int, int]:
    """Write columns stamp_ns int64, row int32, u, sigma (px, 1 sigma) and intensity float32; returns (images, rows).

    Streamed, a row group at a time; the order is that of the stripes.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    schema = pa.schema(
        [
            ("stamp_ns", pa.int64()),
            ("row", pa.int32()),
            ("u", pa.float32()),
            ("sigma", pa.float32()),
            ("intensity", pa.float32()),
        ]
    )
    images = rows = 0
    waiting: list[Stripe] = []
    held = 0
    with pq.ParquetWriter(path, schema, compression="zstd") as writer:
        for stripe in stripes:
            waiting.append(stripe)
            held += len(stripe.row)
            images += 1
            if held >= GROUP_ROWS:
                writer.write_table(pa.table(_columns(waiting), schema=schema))
                rows += held
                waiting, held = [], 0
        if held:
            writer.write_table(pa.table(_columns(waiting), schema=schema))
            rows += held
    return images, rows


def _columns(stripes: list[Stripe]) -> dict[str, Any]:
    return {
        "stamp_ns": np.repeat(
            np.array([stripe.stamp_ns for stripe in stripes], np.int64), [len(stripe.row) for stripe in stripes]
        ),
        "row": np.concatenate([stripe.row for stripe in stripes]),
        "u": np.concatenate([stripe.u for stripe in stripes]),
        "sigma": np.concatenate([stripe.sigma for stripe in stripes]),
        "intensity": np.concatenate([stripe.intensity for stripe in stripes]),
    }
