"""YAML that somebody else wrote: plain values only, and no text that costs more than its length."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from garbi_map.errors import GarbiError

MOST_BYTES = 1 << 20
DEEPEST = 32
LONGEST_NUMBER = 64  # characters; "1:1:1:..." and "0xfff..." are integers of any length, which no text can be made of


class _Loader(yaml.SafeLoader):
    """Without aliases, as ten lines of them can stand for billions of values, and without bottomless nesting."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases (*name) are not taken")
        if self._depth >= DEEPEST:
            raise yaml.YAMLError(f"nested deeper than {DEEPEST}")
        self._depth += 1
        try:
            return super().compose_node(parent, index)
        finally:
            self._depth -= 1

    def construct_number(self, node: yaml.ScalarNode) -> int | float:
        """A number of a length that a human writes."""
        if len(node.value) > LONGEST_NUMBER:
            raise yaml.YAMLError(f"a number of {len(node.value)} characters")
        is_int = node.tag == "tag:yaml.org,2002:int"
        return self.construct_yaml_int(node) if is_int else self.construct_yaml_float(node)


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_number)
_Loader.add_constructor("tag:yaml.org,2002:float", _Loader.construct_number)


def parse_yaml(text: str, where: str) -> Any:
    """The value of a YAML text; `where` names it in errors. Raises GarbiError for what is no YAML, or no plain one."""
    if len(text) > MOST_BYTES:
        raise GarbiError(f"{where}: longer than {MOST_BYTES >> 20} MiB, which is no file that is written by hand")
    try:
        return yaml.load(text, _Loader)
    except (yaml.YAMLError, ValueError, LookupError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise GarbiError(f"{where}: not YAML: {' '.join(str(error).split())[:200]}") from error


def read_yaml(path: Path) -> Any:
    """The value of a YAML file. Raises GarbiError where it cannot be read, too."""
    return parse_yaml(read_text(path), str(path))


def read_text(path: Path) -> str:
    """A short UTF-8 text. Raises GarbiError where it cannot be read or is not short."""
    try:
        with path.open("rb") as file:
            return file.read(MOST_BYTES + 1).decode()
    except OSError as error:
        raise GarbiError(f"{path}: cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise GarbiError(f"{path}: cannot be read: not UTF-8 text") from error
