"""A griffe extension: comments beside the fields of dataclasses become their text in api.md."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import griffe

_COMMENT = re.compile(r"(?<=  # )(?!type:|noqa).*$")


class FieldComments(griffe.Extension):
    """A comment beside a field, or else on the lines above it, is the field's docstring."""

    def on_attribute_instance(
        self, *, node: ast.AST | griffe.ObjectNode, attr: griffe.Attribute, **kwargs: Any
    ) -> None:
        """Set the docstring of a field that has none."""
        if attr.docstring or not isinstance(node, ast.AnnAssign) or attr.lineno is None:
            return
        lines = attr.lines_collection[Path(str(attr.filepath))]
        first, last = attr.lineno - 1, attr.endlineno or attr.lineno
        beside: list[str] = _COMMENT.findall(lines[last - 1])
        above: list[str] = []
        while not beside and lines[first - 1].lstrip().startswith("#"):
            first -= 1
            above.insert(0, lines[first].strip("# "))
        if found := beside or above:
            attr.docstring = griffe.Docstring(" ".join(found), parent=attr)
