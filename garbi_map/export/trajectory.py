"""The trajectory as text, in the format of the TUM benchmark."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from garbi_map.aside import written_aside
from garbi_map.navigate.trajectory import Trajectory


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Lines of `stamp x y z qx qy qz qw`, map <- base_link; seconds with all nine decimals, micrometres.

    Raises GarbiError where the file cannot be written.
    """
    # a double holds the seconds since 1970 to 0.2 microseconds only
    seconds, nanoseconds = np.divmod(trajectory.stamp_ns, 1_000_000_000)
    poses = np.hstack([trajectory.position, trajectory.quaternion])
    with written_aside(path) as aside, aside.open("w") as file:
        for s, ns, pose in zip(seconds.tolist(), nanoseconds.tolist(), poses.tolist(), strict=True):
            file.write("%d.%09d %.6f %.6f %.6f %.9f %.9f %.9f %.9f\n" % (s, ns, *pose))  # noqa: UP031 (twice as fast)
