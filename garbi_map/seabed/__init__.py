"""The seabed: accepted points with sigma, an elevation grid with its uncertainty, a mesh."""

from garbi_map.seabed.builder import SeabedBuilder, build_seabed
from garbi_map.seabed.fusion import FusedCells, SweptPoints, fuse
from garbi_map.seabed.holes import fill_holes
from garbi_map.seabed.mesh import triangulate
from garbi_map.seabed.settings import OutlierSettings, SeabedSettings, SolidSettings
from garbi_map.seabed.solid import SolidSurface
from garbi_map.seabed.stretches import judge_in_stretches
from garbi_map.seabed.surface import CELL_BYTES, SurfaceGrid
from garbi_map.seabed.types import AcceptedPoints, JudgedPoints, Mesh, Points, Seabed, Verdict

__all__ = [
    "CELL_BYTES",
    "AcceptedPoints",
    "FusedCells",
    "JudgedPoints",
    "Mesh",
    "OutlierSettings",
    "Points",
    "Seabed",
    "SeabedBuilder",
    "SeabedSettings",
    "SolidSettings",
    "SolidSurface",
    "SurfaceGrid",
    "SweptPoints",
    "Verdict",
    "build_seabed",
    "fill_holes",
    "fuse",
    "judge_in_stretches",
    "triangulate",
]
