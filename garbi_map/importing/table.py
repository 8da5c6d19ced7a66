"""Comma-separated tables with a heading line, read strictly: the first bad line is told by its number."""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import NoReturn

import numpy as np

from garbi_map.errors import GarbiError
from garbi_map.importing.quantities import TIME, TIME_UNITS, Quantity, heading, match
from garbi_map.log.records import Floats, Stamps

LAST_NS = (1 << 31) * 10**9  # ROS 2 stamps count seconds in 31 bits
LONGEST_LINE = 1 << 16  # characters


@dataclass(frozen=True)
class Table:
    """time (n,) ns, ascending, None where no such column was asked for; numbers: name -> (n,) SI; texts: name -> n
    strings; lines (n,): where each row stands in the file, from 1."""

    path: Path
    time: Stamps
    numbers: dict[str, Floats]
    texts: dict[str, list[str]]
    lines: Stamps

    def stacked(self, quantities: Sequence[Quantity]) -> Floats | None:
        """(n, k) columns side by side; None where they are not there."""
        if any(one.name not in self.numbers for one in quantities):
            return None
        return np.stack([self.numbers[one.name] for one in quantities], axis=1)


def read_table(
    path: Path,
    needed: Sequence[Quantity] = (),
    possible: Sequence[Sequence[Quantity]] = (),
    timed: bool = True,
) -> Table:
    """A table with a time column (if `timed`), the needed columns, and of each group of possible ones all or none.

    Columns that nobody asked for are ignored. Raises GarbiError with the line, what is wrong there and what to do.
    """
    lines = _lines(path)
    number, first = next(lines, (0, ""))
    if not number:
        raise GarbiError(f"{path}: empty; wanted is a heading line such as {_example(needed, timed)} and rows below it")
    delimiter = _delimiter(first)
    cells = _cells(path, number, first.lstrip("#"), delimiter)
    if cells and all(map(_is_number, cells)):
        wanted = _example(needed, timed)
        raise GarbiError(f"{path}: line {number}: numbers instead of headings; begin the file with, say, {wanted}")
    columns = _Columns(path, number, [heading(cell) for cell in cells], needed, possible, timed)
    for number, line in lines:
        columns.add(number, _cells(path, number, line, delimiter))
    return columns.finish()


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """(number, text) of the lines that say something; the first may be a comment, as some write their headings so."""
    seen = False
    try:
        with path.open(encoding="utf-8-sig", newline=None) as file:
            number = 0
            while line := file.readline(LONGEST_LINE):
                number += 1
                if len(line) == LONGEST_LINE:
                    raise GarbiError(f"{path}: line {number}: longer than {LONGEST_LINE} characters; is this a table?")
                if line.strip().strip("#").strip() and (not seen or not line.lstrip().startswith("#")):
                    seen = True
                    yield number, line.strip("\r\n")
    except OSError as error:
        raise GarbiError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise GarbiError(f"{path}: not UTF-8 text ({error.reason}); save it as CSV in UTF-8") from error


def _delimiter(line: str) -> str:
    counts = {mark: line.count(mark) for mark in ",;\t"}
    best = max(counts, key=lambda mark: counts[mark])
    return best if counts[best] else " "


def _cells(path: Path, number: int, line: str, delimiter: str) -> list[str]:
    try:
        rows = list(csv.reader([line.strip(" ")], delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:
        raise GarbiError(f"{path}: line {number}: not a row of a table ({error}); correct or remove it") from error
    return [cell.strip() for cell in rows[0]] if rows else []


def _example(needed: Sequence[Quantity], timed: bool) -> str:
    return ",".join([*(["time_s"] if timed else []), *(one.example for one in needed)])


class _Columns:
    """The columns that were asked for while their rows are read."""

    def __init__(
        self,
        path: Path,
        line: int,
        headings: list[tuple[str, str]],
        needed: Sequence[Quantity],
        possible: Sequence[Sequence[Quantity]],
        timed: bool,
    ) -> None:
        self.path, self.width = path, len(headings)
        self.example = _example(needed, timed)
        self.time: tuple[int, int] | None = None
        self.numbers: list[tuple[str, int, float, array[float]]] = []
        self.texts: list[tuple[str, int, list[str]]] = []
        self.stamps: array[int] = array("q")
        self.lines: array[int] = array("q")
        if timed:
            place, unit = self._find(line, headings, TIME)
            self.time = (place, TIME_UNITS[unit])
        for one in needed:
            self._take(line, headings, one)
        for group in possible:
            if any(match(one, *found) is not None for one in group for found in headings):
                for one in group:
                    self._take(line, headings, one)

    def _fail(self, line: int, what: str) -> NoReturn:
        raise GarbiError(f"{self.path}: line {line}: {what}")

    def _find(self, line: int, headings: list[tuple[str, str]], quantity: Quantity) -> tuple[int, str]:
        found = [(place, unit) for place, one in enumerate(headings) if (unit := match(quantity, *one)) is not None]
        if not found:
            self._fail(line, f"no column {quantity.name}; name one {quantity.example}, say {self.example}")
        if len(found) > 1:
            self._fail(line, f"{len(found)} columns could be {quantity.name}; keep one and rename the others")
        place, unit = found[0]
        if quantity.units and unit not in quantity.units:
            units = " or ".join(quantity.units)
            told = f"in {unit!r}" if unit else "without a unit"
            self._fail(line, f"column {headings[place][0]} {told}; name it {quantity.example} or so ({units})")
        return place, unit

    def _take(self, line: int, headings: list[tuple[str, str]], quantity: Quantity) -> None:
        place, unit = self._find(line, headings, quantity)
        if quantity.text:
            self.texts.append((quantity.name, place, []))
        else:
            self.numbers.append((quantity.name, place, quantity.units.get(unit, 1.0), array("d")))

    def add(self, line: int, cells: list[str]) -> None:
        """Take in a row."""
        if len(cells) != self.width:
            self._fail(line, f"{len(cells)} cells, the heading has {self.width}; correct or remove the line")
        if self.time is not None:
            stamp = self._stamp(line, cells[self.time[0]], self.time[1])
            if self.stamps and stamp <= self.stamps[-1]:
                back = (self.stamps[-1] - stamp) * 1e-9
                told = f"goes back by {back:g} s" if back else "repeats that of the line before"
                self._fail(line, f"its time {told}; sort the rows by time, or remove it")
            self.stamps.append(stamp)
        for name, place, factor, values in self.numbers:
            values.append(self._number(line, name, cells[place], factor))
        for name, place, texts in self.texts:
            if not cells[place]:
                self._fail(line, f"no {name}; fill it in or remove the line")
            texts.append(cells[place])
        self.lines.append(line)

    def _number(self, line: int, name: str, cell: str, factor: float) -> float:
        try:
            value = factor * float(cell) if _is_plain(cell) else math.nan
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            self._fail(line, f"{name} is {_shown(cell)}, not a number; correct or remove the line")
        return value

    def _stamp(self, line: int, cell: str, factor: int) -> int:
        try:
            value = Decimal(cell)
            if not _is_plain(cell) or not value.is_finite() or not 0 <= value < LAST_NS:
                raise InvalidOperation
            stamp = int((value * factor).to_integral_value())
        except InvalidOperation:
            self._fail(line, f"time is {_shown(cell)}, not a time; correct or remove the line")
        if stamp >= LAST_NS:
            self._fail(line, f"time is {_shown(cell)}, after the year 2038; is the unit in the heading right?")
        return stamp

    def finish(self) -> Table:
        """The rows so far."""
        if not self.lines:
            raise GarbiError(f"{self.path}: no rows below the heading line")
        return Table(
            self.path,
            np.array(self.stamps, np.int64),
            {name: np.array(values) for name, _, _, values in self.numbers},
            {name: texts for name, _, texts in self.texts},
            np.array(self.lines, np.int64),
        )


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _is_plain(cell: str) -> bool:
    """Without what Python takes for a part of a number and a table does not mean: 1_000, other scripts' digits."""
    return cell.isascii() and "_" not in cell


def _shown(cell: str) -> str:
    """A cell of an untrusted file, short and on one line."""
    return repr(cell if len(cell) <= 40 else f"{cell[:37]}...")
