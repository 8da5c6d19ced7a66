"""How often each topic of a log speaks, and when it is silent, from the message indexes alone.

A log of hours has millions of index entries. Where reading them all would take long, intervals are learnt from a few
chunks spread over the log, and silences are found from which chunks hold a topic at all: what is shorter than about two
chunks is then not seen.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from typing import BinaryIO

import numpy as np

from garbi_map.log.chunks import DAMAGE
from garbi_map.log.index import Index, Piece, message_times
from garbi_map.log.reader import Log
from garbi_map.log.records import Stamps

GAP_FACTOR, GAP_LEAST = 3.0, 0.2  # times the median interval, s
READ_ALL = 20_000  # message index records that are read without thinking
LOOKED_AT = 40  # chunks of a topic in which its interval is learnt
MOST_HOLES = 500  # of a topic, the longest first

Silence = tuple[int, int]
"""Log times, ns, of the last message before and the first after."""


@dataclass(frozen=True)
class Rhythm:
    """interval: median, s, 0 where it is not known; silences: those longer than usual, with the log's ends."""

    interval: float
    silences: tuple[Silence, ...]


@dataclass(frozen=True)
class Rhythms:
    """By topic. blind: silences shorter than this, s, were not looked for everywhere; 0: all were."""

    topics: dict[str, Rhythm]
    blind: float = 0.0


def find_rhythms(log: Log) -> Rhythms:
    """The rhythm of every topic that has messages."""
    indexes = log.indexes
    if any(index.sampled for index in indexes):
        return _from_stretches(log)
    if not indexes or any(index.times is not None for index in indexes):
        return _exact(log)
    if sum(len(piece.indexes) for index in indexes for piece in index.pieces) <= READ_ALL:
        return _exact(log)
    return _from_chunks(log)


def _exact(log: Log) -> Rhythms:
    times = log.log_times()
    if not times:
        return Rhythms({})
    bounds = min(int(t[0]) for t in times.values()), max(int(t[-1]) for t in times.values())
    found = {}
    for topic, stamps in times.items():
        interval = float(np.median(np.diff(stamps))) * 1e-9 if len(stamps) > 1 else 0.0
        edges = np.concatenate([[bounds[0]], stamps, [bounds[1]]])
        silent = np.flatnonzero(np.diff(edges) * 1e-9 > _limit(interval))
        silences = tuple((int(edges[i]), int(edges[i + 1])) for i in silent) if interval else ()
        found[topic] = Rhythm(interval, silences)
    return Rhythms(found)


def _from_stretches(log: Log) -> Rhythms:
    """Of a log that was only looked at here and there: usual intervals, and no silences."""
    times: dict[str, list[Stamps]] = defaultdict(list)
    for index in log.indexes:
        for channel, parts in (index.times or {}).items():
            times[index.topic(channel)] += parts
    begin, end = log.recorded_span()
    stretches = sum(1 + len(index.stretches) for index in log.indexes)
    rhythms = {}
    for topic, parts in times.items():
        steps = np.diff(np.sort(np.concatenate(parts)))
        often = len(steps) > 3 * stretches  # else most steps lead from one stretch to the next
        rhythms[topic] = Rhythm(float(np.median(steps)) * 1e-9 if often else 0.0, ())
    return Rhythms(rhythms, (end - begin) * 1e-9)


def _limit(interval: float) -> float:
    return max(GAP_FACTOR * interval, GAP_LEAST)


def _from_chunks(log: Log) -> Rhythms:
    begin, end = log.recorded_span()
    places: dict[str, list[tuple[Index, int, Piece]]] = defaultdict(list)
    lengths = []
    for index in log.indexes:
        for piece in index.pieces:
            lengths.append(piece.end - piece.begin)
            for channel in piece.indexes:
                if channel in index.channels:
                    places[index.topic(channel)].append((index, channel, piece))
    with _Files() as files:
        found = {topic: _rhythm(files, chunks, begin, end) for topic, chunks in places.items()}
    return Rhythms(found, max(2 * float(np.median(lengths)) * 1e-9, GAP_LEAST))


def _rhythm(files: _Files, chunks: list[tuple[Index, int, Piece]], begin: int, end: int) -> Rhythm:
    chunks = sorted(chunks, key=lambda one: one[2].begin)
    first, last = np.array([(piece.begin, piece.end) for _, _, piece in chunks], np.int64).T
    steps = [np.diff(files.times(*chunks[k])) for k in np.linspace(0, len(chunks) - 1, LOOKED_AT).astype(int)]
    inside = np.concatenate(steps)
    if not len(inside):
        inside = np.diff(first)  # one message in each chunk
    interval = float(np.median(inside)) * 1e-9 if len(inside) else 0.0
    if not interval:
        return Rhythm(interval, ())
    limit = _limit(interval)
    until = np.maximum.accumulate(last)
    holes = (first[1:] - until[:-1]) * 1e-9
    suspects = np.flatnonzero(holes > 0.5 * limit)
    suspects = np.sort(suspects[np.argsort(-holes[suspects], kind="stable")[:MOST_HOLES]])
    edges = [(begin, files.edge(chunks[0], -1, begin))]
    edges += [
        (files.edge(chunks[k], 1, int(last[k])), files.edge(chunks[k + 1], -1, int(first[k + 1]))) for k in suspects
    ]
    edges.append((files.edge(chunks[int(last.argmax())], 1, end), end))
    return Rhythm(interval, tuple((a, b) for a, b in edges if (b - a) * 1e-9 > limit))


class _Files:
    """The files of a log, each opened once."""

    def __init__(self) -> None:
        self._open: dict[int, BinaryIO] = {}

    def __enter__(self) -> _Files:
        return self

    def __exit__(self, *_: object) -> None:
        for file in self._open.values():
            file.close()

    def times(self, index: Index, channel: int, piece: Piece) -> Stamps:
        """Log times of a channel's messages in a piece, ascending; none where its message index is damaged."""
        if id(index) not in self._open:
            self._open[id(index)] = index.open()
        one = Piece(piece.offset, piece.length, piece.begin, piece.end, indexes={channel: piece.indexes[channel]})
        try:
            return np.sort(message_times(self._open[id(index)], one)[channel])
        except DAMAGE:
            return np.empty(0, np.int64)

    def edge(self, chunk: tuple[Index, int, Piece], side: int, otherwise: int) -> int:
        """First (-1) or last (1) message of a chunk; `otherwise` where that cannot be read."""
        times = self.times(*chunk)
        return int(times[0 if side < 0 else -1]) if len(times) else otherwise
