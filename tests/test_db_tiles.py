"""What the cells of submaps remember, on disk, makes the map that all points together make."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation
from test_db_kept import judged

from garbi_map.db.submaps import Pose, read_submap, write_submap
from garbi_map.db.tiles import fuse_submap, merge_memories
from garbi_map.seabed import SeabedSettings, SurfaceGrid


def test_submaps_fused_apart_and_merged_are_their_sweeps_fused_together(tmp_path: Path) -> None:
    """Through files, at a turned pose; where fewer cells may be, they are larger, and hold the same points."""
    settings, whole, memories = SeabedSettings(cell=0.05), SurfaceGrid(SeabedSettings(cell=0.05)), []
    for number in range(2):
        points = judged(2000, 10 + number)
        written = write_submap(tmp_path, str(number), [(0, points, points.points)])
        pose = Pose(np.array([1.0, 2.0, 0.5]), Rotation.from_euler("zyx", [0.5, 0.02, -0.03]).as_quat())
        for sweep in read_submap(tmp_path / written.file).sweeps(pose):
            whole.add(sweep)
        target = tmp_path / f"memories/{number}.parquet"
        memories.append((target, fuse_submap(tmp_path / written.file, pose, settings, target)))
    wanted, found = whole.finish(), merge_memories(memories, settings).finish()
    np.testing.assert_array_equal(found.density, wanted.density)
    np.testing.assert_allclose(found.elevation, wanted.elevation, rtol=1e-6)
    np.testing.assert_allclose(found.uncertainty, wanted.uncertainty, rtol=1e-4)
    coarse = merge_memories(memories, SeabedSettings(cell=0.05, max_cells=20_000)).finish()
    assert coarse.cell == 0.1 and coarse.density.size <= 20_000
    assert coarse.density.sum() == found.density.sum() == 4000
