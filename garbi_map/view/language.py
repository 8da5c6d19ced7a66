"""The one table of the visual language: `python -m garbi_map.view.language` prints what docs/visual-language.md holds."""

from __future__ import annotations

from garbi_map.view import style


def page() -> str:
    """Markdown: everything that is drawn, with entity path, colour and meaning; bands, curves and colourings."""
    things = [one for one in vars(style).values() if isinstance(one, style.Thing)]
    things += [style.proposal(name) for name in ("avoidance", "travel", "hold", "survey")]
    plots = [one for one in vars(style).values() if isinstance(one, style.Plot)] + [style.activation("NAME")]
    rows = [f"| {one.name} | `{one.path}` | {_hex(one.colour)} | {one.meaning} |" for one in things]
    curves = [f"| {plot.title} | `{plot.path}` | {_curves(plot)} |" for plot in plots]
    colourings = [f"| {one.name} | `{one.component}` | {one.meaning} |" for one in style.COLOURINGS]
    bands = [f"| {name} | {_hex(colour)} |" for name, colour in style.STATES.items()]
    return "\n".join(
        [
            "# The visual language",
            "",
            "What colours, names, units and entity paths mean; the same in logs, maps and decisions. One timeline,",
            f"`{style.TIMELINE}`, holds the moments of measurement. Metres and radians unless a name says otherwise;",
            "x, y, z and roll, pitch, yaw are red, green, blue. The source of this page is `garbi_map/view/style.py`.",
            "",
            "| what | entity path | colour | means |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
            "| curves, with unit | entity path | |",
            "| --- | --- | --- |",
            *curves,
            "",
            "| colouring of the map | component | means |",
            "| --- | --- | --- |",
            *colourings,
            "",
            f"| band (under `{style.LANES}/`) | colour |",
            "| --- | --- |",
            *bands,
            "",
        ]
    )


def _hex(colour: style.Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)


def _curves(plot: style.Plot) -> str:
    return ", ".join(f"{name} {_hex(colour)}" for name, colour in plot.curves)


if __name__ == "__main__":
    print(page(), end="")
