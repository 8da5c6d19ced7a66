"""The result of a stage on disk, so that a run which was stopped goes on after it, bit for bit."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Iterable
from dataclasses import fields, is_dataclass
from pathlib import Path
from typing import Any

import numpy as np

from garbi_map.aside import make_folder, written_aside


def keep(path: Path, result: Any) -> None:
    """Write dataclasses, lists, tuples, dicts, arrays, numbers and texts, however nested, into one file.

    Complete or absent; nothing in it is code. Raises GarbiError where it cannot be written.
    """
    arrays: dict[str, Any] = {}
    tree = json.dumps(_told(result, arrays))
    make_folder(path.parent)
    with written_aside(path) as aside, aside.open("wb") as file:
        np.savez(file, tree=np.array(tree), **arrays)


def recall(path: Path, kinds: Iterable[type]) -> Any:
    """What `keep` wrote, of these dataclasses only; None where there is nothing that can be read."""
    known = {kind.__name__: kind for kind in kinds}
    try:
        with np.load(path, allow_pickle=False) as file:
            return _built(json.loads(str(file["tree"])), file, known)
    except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):
        return None


def _told(value: Any, arrays: dict[str, np.ndarray]) -> Any:
    if isinstance(value, np.ndarray):
        arrays[name := f"a{len(arrays)}"] = value
        return {"array": name}
    if is_dataclass(value):
        return {
            "kind": type(value).__name__,
            "fields": {field.name: _told(getattr(value, field.name), arrays) for field in fields(value)},
        }
    if isinstance(value, dict):
        return {"dict": [[_told(key, arrays), _told(one, arrays)] for key, one in value.items()]}
    if isinstance(value, list | tuple):
        return {type(value).__name__: [_told(one, arrays) for one in value]}
    if isinstance(value, np.generic):
        return value.item()
    return value


def _built(told: Any, file: Any, known: dict[str, type]) -> Any:
    if not isinstance(told, dict):
        return told
    if "array" in told:
        return file[told["array"]]
    if "kind" in told:
        parts = {name: _built(one, file, known) for name, one in told["fields"].items()}
        return known[told["kind"]](**parts)
    if "dict" in told:
        return {_built(key, file, known): _built(one, file, known) for key, one in told["dict"]}
    return (
        [_built(one, file, known) for one in told["list"]]
        if "list" in told
        else tuple(_built(one, file, known) for one in told["tuple"])
    )
