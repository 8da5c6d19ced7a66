"""Files that people open: each complete or absent."""

from garbi_map.aside import write_text, written_aside
from garbi_map.export.cloud import CloudWriter, also_copc, read_cloud
from garbi_map.export.contours import write_contours
from garbi_map.export.copc import POINT_BYTES
from garbi_map.export.drift import correction
from garbi_map.export.georeference import Georeference
from garbi_map.export.glb import write_glb
from garbi_map.export.hillshade import write_hillshade
from garbi_map.export.origin import Located, Origin, check_origin, locate
from garbi_map.export.ply import write_ply
from garbi_map.export.raster import write_seabed_tif
from garbi_map.export.report import Place, Quantity, Report, Source, Span, Topic, describe_seabed, write_report_json
from garbi_map.export.report_html import write_report_html
from garbi_map.export.s44 import bathymetry
from garbi_map.export.settings import ExportSettings
from garbi_map.export.trajectory import write_trajectory
from garbi_map.export.verdict import plain_verdict
from garbi_map.export.weak import weak_places

__all__ = [
    "POINT_BYTES",
    "CloudWriter",
    "ExportSettings",
    "Georeference",
    "Located",
    "Origin",
    "Place",
    "Quantity",
    "Report",
    "Source",
    "Span",
    "Topic",
    "also_copc",
    "bathymetry",
    "check_origin",
    "correction",
    "describe_seabed",
    "locate",
    "plain_verdict",
    "read_cloud",
    "weak_places",
    "write_contours",
    "write_glb",
    "write_hillshade",
    "write_ply",
    "write_report_html",
    "write_report_json",
    "write_seabed_tif",
    "write_text",
    "write_trajectory",
    "written_aside",
]
