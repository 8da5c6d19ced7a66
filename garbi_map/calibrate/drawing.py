"""Targets to print: SVG or PDF, at true size, one page for each face."""

from __future__ import annotations

from html import escape
from pathlib import Path

from garbi_map.calibrate.files import write_aside
from garbi_map.calibrate.targets import AnyTarget, Face
from garbi_map.errors import GarbiError

MARGIN = 0.015  # m, white paper around what is printed
POINT = 72 / 0.0254  # PDF units per metre


def write_drawing(path: Path, target: AnyTarget) -> None:
    """Write .svg or .pdf, complete or not at all. Raises GarbiError for another suffix."""
    note = f"{target.kind}: print at 100 %, then measure: the first square's side is {1e3 * _side(target):g} mm"
    if path.suffix == ".svg":
        write_aside(path, _svg(target.faces, note).encode())
    elif path.suffix == ".pdf":
        write_aside(path, _pdf(target.faces, note))
    else:
        raise GarbiError(f"{path}: a target is drawn as .pdf or .svg")


def _side(target: AnyTarget) -> float:
    return target.tag if target.kind == "apriltag" else target.square


def _svg(faces: list[Face], note: str) -> str:
    parts = []
    top = MARGIN
    width = max(float(face.size[0]) for face in faces) + 2 * MARGIN
    for face in faces:
        path = "".join(
            f"M{1e3 * (x + MARGIN):.4f} {1e3 * (y + top):.4f}h{1e3 * w:.4f}v{1e3 * h:.4f}h{-1e3 * w:.4f}z"
            for x, y, w, h in face.black.tolist()
        )
        parts.append(f'<path d="{path}"/>')
        top += float(face.size[1]) + 2 * MARGIN
    height = top - MARGIN + MARGIN
    label = (
        f'<text x="{1e3 * MARGIN}" y="{1e3 * height - 4}" font-size="4" font-family="sans-serif">{escape(note)}</text>'
    )
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{1e3 * width:.3f}mm" height="{1e3 * height:.3f}mm" '
        f'viewBox="0 0 {1e3 * width:.3f} {1e3 * height:.3f}" shape-rendering="crispEdges">'
        f'<rect width="100%" height="100%" fill="white"/>{"".join(parts)}{label}</svg>\n'
    )


def _pdf(faces: list[Face], note: str) -> bytes:
    """A PDF 1.4 of filled rectangles (ISO 32000-1, 7.5 and 8.5)."""
    objects: list[bytes] = [b"", b"", b"<</Type/Font/Subtype/Type1/BaseFont/Helvetica>>"]
    pages = []
    for face in faces:
        width, height = (POINT * (float(size) + 2 * MARGIN) for size in face.size)
        boxes = "".join(
            f"{POINT * (x + MARGIN):.4f} {height - POINT * (y + h + MARGIN):.4f} {POINT * w:.4f} {POINT * h:.4f} re\n"
            for x, y, w, h in face.black.tolist()
        )
        text = note.replace("\\", "\\\\").replace("(", "\\(").replace(")", "\\)")
        stream = f"0 g\n{boxes}f\nBT /F1 8 Tf {POINT * MARGIN:.2f} 14 Td ({text}) Tj ET\n".encode("latin-1")
        objects.append(b"<</Length %d>>stream\n%sendstream" % (len(stream), stream))
        page = f"<</Type/Page/Parent 2 0 R/MediaBox[0 0 {width:.4f} {height:.4f}]/Contents {len(objects)} 0 R"
        objects.append(f"{page}/Resources<</Font<</F1 3 0 R>>>>>>".encode())
        pages.append(len(objects))
    objects[0] = b"<</Type/Catalog/Pages 2 0 R>>"
    kids = " ".join(f"{number} 0 R" for number in pages)
    objects[1] = f"<</Type/Pages/Kids[{kids}]/Count {len(pages)}>>".encode()
    out = bytearray(b"%PDF-1.4\n")
    places = []
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % place for place in places)
    out += b"trailer<</Size %d/Root 1 0 R>>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, table)
    return bytes(out)
