"""Which sources a result comes from: flights with other behaviours, or in other water, are not to be mixed in unnoticed."""

from __future__ import annotations

import ast
import hashlib
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
DECIDING = ("behaviours", "tools", "garbi_map/rig")  # nothing else that is imported makes the vehicle go elsewhere


@cache
def fingerprint(root: Path = ROOT, first: str = "tools/trials/avoidance.py") -> str:
    """Eight digits of all that the file `first` imports from DECIDING; comments, docstrings and layout do not count."""
    left, trees = [first], dict[str, ast.Module]()
    while left:
        path = left.pop()
        if path not in trees:
            trees[path] = ast.parse((root / path).read_text())
            left += _imported(trees[path], root)
    digest = hashlib.sha256()
    for path in sorted(trees):
        digest.update(f"{path}\n{ast.unparse(_bare(trees[path]))}\n".encode())
    return digest.hexdigest()[:8]


def _imported(tree: ast.Module, root: Path) -> list[str]:
    """Files within DECIDING that are imported anywhere in a module."""
    names = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
    found = []
    for name in names:
        path = name.replace(".", "/")
        if path.startswith(DECIDING):
            found += [file for file in (f"{path}.py", f"{path}/__init__.py") if (root / file).is_file()]
    return found


def _bare(tree: ast.Module) -> ast.Module:
    """Without docstrings."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            node.body = node.body[1:] or [ast.Pass()]
    return tree
