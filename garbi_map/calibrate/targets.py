"""Calibration targets: target.yaml in, and what lies where on them.

A target is made of flat faces. On a face, x runs to the right and y down as printed; the third axis points into the
face, away from who looks at it. All lengths in metres.
"""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from typing import Annotated, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError, model_validator

from garbi_map.errors import GarbiError
from garbi_map.log.records import Floats
from garbi_map.plain_yaml import parse_yaml, read_text
from garbi_map.settings import Settings

Count = Annotated[int, Field(ge=1, le=100)]
Length = Annotated[float, Field(gt=0, le=10, allow_inf_nan=False)]
Vector = tuple[float, float, float]


class Face(NamedTuple):
    """A flat face of a target, target frame.

    origin, u, v   (3,) m, and unit directions of its x and y
    size           (2,) m, of the printed area
    black          (k, 4) m: x, y, width, height of its black rectangles
    """

    origin: Floats
    u: Floats
    v: Floats
    size: Floats
    black: Floats

    @property
    def normal(self) -> Floats:
        """(3,) into the face."""
        return np.cross(self.u, self.v)

    def at(self, xy: Floats) -> Floats:
        """Points (n, 3) of places (n, 2) on the face."""
        return self.origin + xy[:, :1] * self.u + xy[:, 1:] * self.v


class _Target(Settings):
    """What all targets answer. `points` (n, 3) m: what is detected, in the order of its numbers."""

    border: float = Field(
        default=0.0,
        ge=0,
        le=2,
        description="the board is flat that far beyond what is printed, and the stripe counts, m",
    )

    @cached_property
    def faces(self) -> list[Face]:
        raise NotImplementedError

    @cached_property
    def points(self) -> Floats:
        raise NotImplementedError

    @property
    def planar(self) -> bool:
        """Whether one face is all there is."""
        return len(self.faces) == 1

    @property
    def least_points(self) -> int:
        """Fewer detected points in an image are not a view."""
        return 8 if self.planar else 16


def _flat(size: tuple[float, float], black: Floats) -> list[Face]:
    return [Face(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), np.array(size), black)]


def _on_plane(xy: NDArray) -> Floats:
    return np.column_stack([xy, np.zeros(len(xy))])


def _grid(columns: int, rows: int) -> NDArray[np.int64]:
    """(columns rows, 2) column and row, row by row."""
    row, column = np.mgrid[:rows, :columns]
    return np.column_stack([column.ravel(), row.ravel()])


def _modules(bits: NDArray[np.uint8], corner: Floats, side: float) -> Floats:
    """(k, 4) black rectangles of a marker (m, m) of 0 (black) and 255, its upper left corner (2,) and its side."""
    row, column = np.nonzero(bits < 128)
    step = side / len(bits)
    one = np.full(len(row), step)
    return np.column_stack([corner[0] + column * step, corner[1] + row * step, one, one])


class Checkerboard(_Target):
    """A chessboard. Points: inner corners, row by row; the origin is the first of them."""

    kind: Literal["checkerboard"]
    inner_corners: tuple[Annotated[int, Field(ge=3, le=100)], Annotated[int, Field(ge=3, le=100)]]  # columns, rows
    square: Length  # m
    corner_is_black: bool = Field(
        default=False,
        description="the square in the upper left corner is known to be black, as `garbi calibrate target` prints it: "
        "mirrored images of a board with two different odd numbers of corners are then refused",
    )

    @cached_property
    def points(self) -> Floats:
        return _on_plane(self.square * _grid(*self.inner_corners))

    @cached_property
    def faces(self) -> list[Face]:
        cell = _grid(self.inner_corners[0] + 1, self.inner_corners[1] + 1)
        cell = cell[cell.sum(axis=1) % 2 == 0]
        black = np.column_stack([self.square * (cell - 1), np.full((len(cell), 2), self.square)])
        size = (self.square * (self.inner_corners[0] + 1), self.square * (self.inner_corners[1] + 1))
        black[:, :2] += self.square
        return [_flat(size, black)[0]._replace(origin=np.array([-self.square, -self.square, 0.0]))]


class Charuco(_Target):
    """A chessboard with a marker in each white square. Points: inner corners, row by row."""

    kind: Literal["charuco"]
    squares: tuple[Annotated[int, Field(ge=3, le=60)], Annotated[int, Field(ge=3, le=60)]]  # columns, rows
    square: Length  # m
    marker: Length  # m
    dictionary: str = "DICT_4X4_250"

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not 0.3 * self.square <= self.marker <= 0.95 * self.square:
            raise ValueError("marker must be 0.3 to 0.95 of square")
        _dictionary(self.dictionary, (self.squares[0] * self.squares[1]) // 2)
        return self

    @cached_property
    def points(self) -> Floats:
        return _on_plane(self.square * (_grid(self.squares[0] - 1, self.squares[1] - 1) + 1.0))

    @cached_property
    def faces(self) -> list[Face]:
        cell = _grid(*self.squares)
        dark = cell[cell.sum(axis=1) % 2 == 0]
        white = cell[cell.sum(axis=1) % 2 == 1]
        black = [np.column_stack([self.square * dark, np.full((len(dark), 2), self.square)])]
        inset = (self.square - self.marker) / 2
        dictionary = _dictionary(self.dictionary, len(white))
        black += [
            _modules(_marker(dictionary, number), self.square * place + inset, self.marker)
            for number, place in enumerate(white)
        ]
        return _flat((self.square * self.squares[0], self.square * self.squares[1]), np.concatenate(black))


class AprilTags(_Target):
    """A grid of AprilTags. Points: four corners of each tag (upper left first, clockwise), tags row by row from 0."""

    kind: Literal["apriltag"]
    tags: tuple[Count, Count]  # columns, rows
    tag: Length  # m, side of the black square
    gap: Length  # m, between two tags
    family: Literal["tag16h5", "tag25h9", "tag36h10", "tag36h11"] = "tag36h11"

    @model_validator(mode="after")
    def _fits(self) -> Self:
        _dictionary(self.dictionary, self.tags[0] * self.tags[1])
        return self

    @property
    def dictionary(self) -> str:
        """Name of the family as OpenCV has it."""
        return "DICT_APRILTAG_" + self.family.removeprefix("tag")

    @cached_property
    def _corner(self) -> Floats:
        return np.asarray((self.tag + self.gap) * _grid(*self.tags) + self.gap, float)

    @cached_property
    def points(self) -> Floats:
        around = self.tag * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        return _on_plane((self._corner[:, None] + around).reshape(-1, 2))

    @cached_property
    def faces(self) -> list[Face]:
        dictionary = _dictionary(self.dictionary, len(self._corner))
        black = [_modules(_marker(dictionary, number), corner, self.tag) for number, corner in enumerate(self._corner)]
        columns, rows = self.tags
        pitch = self.tag + self.gap
        return _flat((columns * pitch + self.gap, rows * pitch + self.gap), np.concatenate(black))


class Plane(Settings):
    """Where a face of the two-plane target lies: its upper left printed corner, m, and its x and y directions."""

    origin: Vector
    u: Vector
    v: Vector

    @model_validator(mode="after")
    def _is_a_plane(self) -> Self:
        u, v = np.array(self.u), np.array(self.v)
        if abs(np.linalg.norm(u) - 1) > 1e-3 or abs(np.linalg.norm(v) - 1) > 1e-3 or abs(u @ v) > 1e-3:
            raise ValueError("u and v must be of length 1 and at right angles")
        return self


class TwoPlanes(_Target):
    """The paper's: two planes with black squares. Points: four vertices of each square (upper left first, clockwise),
    squares row by row, one plane after the other. The first square begins at the plane's origin."""

    kind: Literal["two_planes"]
    squares: tuple[Annotated[int, Field(ge=2, le=60)], Annotated[int, Field(ge=2, le=60)]]  # columns, rows of a plane
    square: Length  # m
    pitch: Length  # m, from one square to the next
    planes: tuple[Plane, Plane]

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if not 1.15 * self.square <= self.pitch:
            raise ValueError("pitch must be at least 1.15 times square, or the squares touch")
        first, second = (np.cross(plane.u, plane.v) for plane in self.planes)
        if abs(first @ second) > 0.94:
            raise ValueError("the planes must differ by more than 20 degrees")
        return self

    @cached_property
    def faces(self) -> list[Face]:
        corner = self.pitch * _grid(*self.squares)
        black = np.column_stack([corner, np.full((len(corner), 2), self.square)])
        size = self.pitch * (np.array(self.squares) - 1) + self.square
        return [Face(np.array(p.origin), np.array(p.u), np.array(p.v), size, black) for p in self.planes]

    @cached_property
    def points(self) -> Floats:
        around = self.square * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
        corner = (self.pitch * _grid(*self.squares)[:, None] + around).reshape(-1, 2)
        return np.concatenate([face.at(corner) for face in self.faces])


AnyTarget = Checkerboard | Charuco | AprilTags | TwoPlanes
_TARGET: TypeAdapter[AnyTarget] = TypeAdapter(Annotated[AnyTarget, Field(discriminator="kind")])


def load_target(path: Path) -> AnyTarget:
    """The target of a file. Raises GarbiError that names the file, the key and what is wrong with it."""
    return parse_target(read_text(Path(path)), str(path))


def parse_target(text: str, where: str) -> AnyTarget:
    """The target of a YAML text; `where` names it in errors. Raises GarbiError."""
    try:
        return _TARGET.validate_python(parse_yaml(text, where))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(part) for part in first["loc"][1:]) or "kind"
        raise GarbiError(f"{where}: {key}: {first['msg']}") from error


def dictionary_of(target: Charuco | AprilTags) -> object:
    """OpenCV's dictionary of the target's markers."""
    import cv2

    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, target.dictionary))


def _dictionary(name: str, count: int) -> object:
    import cv2

    number = getattr(cv2.aruco, name, None) if name.startswith("DICT_") else None
    if not isinstance(number, int):
        raise ValueError(f"no dictionary of OpenCV is called {name!r}; DICT_4X4_250 is one")
    dictionary = cv2.aruco.getPredefinedDictionary(number)
    if count > len(dictionary.bytesList):
        raise ValueError(f"{count} markers are needed, {name} has {len(dictionary.bytesList)}")
    return dictionary


def _marker(dictionary: object, number: int) -> NDArray[np.uint8]:
    side = dictionary.markerSize + 2  # type: ignore[attr-defined]
    return np.asarray(dictionary.generateImageMarker(number, side), np.uint8)  # type: ignore[attr-defined]
