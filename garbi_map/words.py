"""Numbers as a reader wants them in a sentence."""

from __future__ import annotations


def length(metres: float) -> str:
    """Two digits with the unit that suits: "0.12 mm", "3.4 cm", "1.2 m"."""
    size = abs(metres)
    if size < 0.01:
        return f"{_digits(1e3 * metres)} mm"
    return f"{_digits(100 * metres)} cm" if size < 1 else f"{_digits(metres)} m"


def angle(degrees: float) -> str:
    """Two digits: "0.12°"."""
    return f"{_digits(degrees)}°"


def percent(share: float) -> str:
    """Of one: "3 %", "0.4 %", "98.6 %"; never rounded to nothing or to all."""
    value = 100 * share
    if value in (0, 100):
        return f"{value:.0f} %"
    if value < 0.1:
        return "less than 0.1 %"
    if value > 99.9:
        return "more than 99.9 %"
    if value < 1:
        return f"{float(f'{value:.1g}'):g} %"
    return f"{value:.1f} %" if value > 99 else f"{value:.0f} %"


def many(count: int, thing: str, things: str | None = None) -> str:
    """Singular or plural: "1 sweep", "7 sweeps"."""
    return f"{count:,} {thing if count == 1 else things or thing + 's'}"


def printable(text: str) -> str:
    """What a terminal may be given of a text that somebody else wrote: no control characters, on one line."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in text)


def _digits(value: float) -> str:
    """Two significant digits, never in powers of ten."""
    return f"{value:.0f}" if abs(value) >= 10 else f"{float(f'{value:.2g}'):g}"
