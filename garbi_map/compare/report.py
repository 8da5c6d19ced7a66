"""What a comparison says, on one page and for programs."""

from __future__ import annotations

import json
from base64 import b64encode
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from garbi_map import __version__
from garbi_map.aside import write_text
from garbi_map.compare.patches import Patch
from garbi_map.compare.picture import picture
from garbi_map.compare.run import Comparison
from garbi_map.compare.settings import CompareSettings
from garbi_map.export.hillshade import png
from garbi_map.view import style
from garbi_map.view.about import legend
from garbi_map.words import angle, length, many, percent

OUTPUTS = {
    "change.tif": "distance, level of detection and significance per cell",
    "changes.csv": "the patches that changed",
    "changes.gpkg": "their outlines, in the reference system of the first map",
    "compare.rrd": "both surfaces and what changed in Rerun: garbi view DIR",
    "report.json": "this report, for programs",
    "report.html": "this report",
}

ON_EARTH = {"changes.geojson": "the same in longitude and latitude (WGS 84)"}
"""Where the first map is georeferenced."""

_STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1b2128; max-width: 980px; margin: 2em auto; padding: 0 1em; }
h1 { font-size: 1.5em; margin-bottom: 0; } h2 { font-size: 1.1em; margin-top: 1.6em; }
p.sub { color: #5a6672; margin-top: .2em; } img { width: 100%; image-rendering: pixelated; }
table { border-collapse: collapse; width: 100%; } td, th { padding: .3em .6em; border-bottom: 1px solid #dde2e6; }
td { text-align: right; white-space: nowrap; }
td:nth-child(2) { text-align: left; } th { text-align: right; font-weight: 600; }
p.verdict { font-size: 1.15em; background: #eef4f6; padding: .8em 1em; border-radius: 6px; }
"""


def write_report(out: Path, found: Comparison, settings: CompareSettings) -> None:
    """report.json and report.html, each complete or not at all."""
    write_text(out / "report.json", json.dumps(_model(found, settings), indent=2) + "\n")
    write_text(out / "report.html", _page(found))


def verdict(found: Comparison) -> str:
    """What changed, in plain sentences."""
    area = np.count_nonzero(found.change.compared) * found.change.cell**2
    seen = f"{area:.2g} m² were seen in both maps; a change of {length(_detection(found))} shows in half of it."
    if not found.patches:
        return f"Nothing changed. {seen}"
    kinds = [(kind, sum(patch.kind == kind for patch in found.patches)) for kind in ("moved", "appeared", "vanished")]
    told = ", ".join(f"{many(count, 'thing')} {kind}" for kind, count in kinds if count)
    share = float(np.count_nonzero(found.labels)) / max(float(np.count_nonzero(found.change.compared)), 1.0)
    return f"{told[0].upper()}{told[1:]}: {percent(min(share, 1.0))} of what both maps show. {seen}"


def about(found: Comparison) -> str:
    """Markdown: what the recording shows."""
    things = (style.RISEN, style.FALLEN, style.MOVE)
    return f"""\
**{verdict(found)}**

{legend(things)} The tabs: the earlier surface with what changed; *Before* and *After*: either surface by itself.
"""


def _detection(found: Comparison) -> float:
    return float(np.nanmedian(found.change.detection))


def _model(found: Comparison, settings: CompareSettings) -> dict[str, Any]:
    motion, change = found.motion, found.change
    sigma = np.sqrt(np.diag(motion.covariance))
    return {
        "created": datetime.now(UTC).isoformat(timespec="seconds"),
        "maps": [{"path": str(one.path), "title": one.title, "created": one.created} for one in _maps(found)],
        "verdict": verdict(found),
        "alignment": {
            "rotation_matrix": motion.rotation.tolist(),
            "shift_m": motion.shift.tolist(),
            "sigma_rad": sigma[:3].tolist(),
            "sigma_m": sigma[3:].tolist(),
            "overlap": motion.overlap,
            "relief_in_common": motion.explained,
            "median_distance_m": motion.residual,
        },
        "compared_m2": float(np.count_nonzero(change.compared)) * change.cell**2,
        "changed_m2": float(np.count_nonzero(found.labels)) * change.cell**2,
        "level_of_detection_median_m": _detection(found),
        "uncertainty_excess": change.excess,
        "changes": [_entry(patch) for patch in found.patches],
        "configuration": settings.model_dump(mode="json"),
        "versions": {"garbi": __version__},
        "outputs": OUTPUTS | ({} if change.reference.is_local else ON_EARTH),
    }


def _entry(patch: Patch) -> dict[str, Any]:
    return {
        "number": patch.number,
        "kind": patch.kind,
        "place_m": list(patch.place),
        "area_m2": patch.area,
        "gained_m3": patch.gained,
        "lost_m3": patch.lost,
        "sigma_m3": patch.sigma,
        "largest_m": patch.largest,
        "mean_m": patch.mean,
        "level_of_detection_m": patch.detection,
        "move_m": None if patch.move is None else list(patch.move),
        "moved_m": patch.moved,
    }


def _maps(found: Comparison) -> list[Any]:
    return [found.first, found.second]


def _page(found: Comparison) -> str:
    first, second = _maps(found)
    motion = found.motion
    turn = float(np.degrees(np.linalg.norm(Rotation.from_matrix(motion.rotation).as_rotvec())))
    sigma = np.sqrt(np.diag(motion.covariance))
    image = b64encode(png(picture(found.change, found.patches, found.labels))).decode()
    laid = (
        f"The second map was turned by {angle(turn)} and shifted by {length(float(np.linalg.norm(motion.shift)))} onto the "
        f"first, on what did not change; that is good to {length(float(np.linalg.norm(sigma[3:])))} (1 sigma). "
        f"{percent(motion.overlap)} of the smaller map overlaps, and there the two are {length(motion.residual)} apart "
        f"in the median. Half the cells have a level of detection below {length(_detection(found))} (95 %: both maps' "
        "uncertainty, the scatter of their points, the alignment)."
    )
    rows = "".join(_line(patch) for patch in found.patches)
    heading = "".join(
        f"<th>{name}</th>"
        for name in (
            "",
            "what",
            "x, m",
            "y, m",
            "area, cm²",
            "gained, cm³",
            "lost, cm³",
            "± cm³",
            "mean",
            "largest",
            "detected from",
            "moved by",
        )
    )
    table = f"<table><tr>{heading}</tr>{rows}</table>" if rows else "<p>No change was found.</p>"
    return f"""<!doctype html><html lang="en"><meta charset="utf-8"><title>What changed</title><style>{_STYLE}</style>
<h1>What changed</h1><p class="sub">{escape(first.title)} ({escape(str(first.path))}), then {escape(second.title)}
({escape(str(second.path))})</p>
<p class="verdict">{escape(verdict(found))}</p>
<img alt="The first map from above; red has risen, blue has fallen" src="data:image/png;base64,{image}">
<p class="sub">North up, relief of the first map; red has risen, blue has fallen, numbers as below; dark where only one map
knows the seabed.</p>
<h2>Patches</h2>{table}
<h2>How the two were laid on each other</h2><p>{escape(laid)}</p>
</html>
"""


def _line(patch: Patch) -> str:
    cells = (
        str(patch.number),
        patch.kind,
        f"{patch.place[0]:.3f}",
        f"{patch.place[1]:.3f}",
        f"{1e4 * patch.area:.1f}",
        f"{1e6 * patch.gained:.1f}",
        f"{1e6 * patch.lost:.1f}",
        f"{1e6 * patch.sigma:.1f}",
        length(patch.mean),
        length(patch.largest),
        length(patch.detection),
        "" if patch.moved is None else length(patch.moved),
    )
    return "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in cells) + "</tr>"
