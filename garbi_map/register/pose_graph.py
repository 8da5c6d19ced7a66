"""One answer from all constraints between sweeps: Open3D's pose graph with a line process against false loops."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from garbi_map.register.front_end import Constraint

Floats = NDArray[np.float64]


def optimise(corrections: list[Floats], constraints: list[Constraint], neighbour: Floats) -> list[Floats]:
    """The corrections (4, 4) of the sweeps that agree best with all constraints; the first stays where it is.

    neighbour (6,): 1 sigma (m, m, m, rad, rad, rad) of how much the correction changes from one sweep to the next, which is
    what the trajectory itself says of neighbouring sweeps. Levenberg-Marquardt with switchable loop constraints (Choi, Zhou
    and Koltun, CVPR 2015).
    """
    import open3d as o3d

    registration = o3d.pipelines.registration
    if len(corrections) < 2:
        return corrections
    graph = registration.PoseGraph()
    for correction in corrections:
        graph.nodes.append(registration.PoseGraphNode(correction))
    trusted = np.diag(1.0 / np.asarray(neighbour) ** 2)
    for k in range(len(corrections) - 1):
        graph.edges.append(registration.PoseGraphEdge(k + 1, k, np.eye(4), _open3d_order(trusted), uncertain=False))
    for edge in constraints:
        information = _open3d_order(_about_origin(edge.information, edge.centre))
        graph.edges.append(
            registration.PoseGraphEdge(edge.second, edge.first, edge.transform, information, uncertain=edge.uncertain)
        )
    registration.global_optimization(
        graph,
        registration.GlobalOptimizationLevenbergMarquardt(),
        registration.GlobalOptimizationConvergenceCriteria(),
        registration.GlobalOptimizationOption(
            max_correspondence_distance=0.05, edge_prune_threshold=0.25, reference_node=0
        ),
    )
    return [np.array(node.pose) for node in graph.nodes]


def _about_origin(information: Floats, centre: Floats) -> Floats:
    """The same information for a motion (translation, rotation) about the origin instead of about `centre` (3,)."""
    x, y, z = centre
    to_centre = np.eye(6)
    to_centre[:3, 3:] = -np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return to_centre.T @ information @ to_centre


def _open3d_order(information: Floats) -> Floats:
    """Open3D wants rotation first."""
    order = [3, 4, 5, 0, 1, 2]
    return information[np.ix_(order, order)]
