"""A griffe extension: comments beside the fields of dataclasses become their text in api.md."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any

import griffe

_COMMENT = re.compile(r"(?<=#).*$")


class FieldComments(griffe.Extension):
    """A comment behind a field, or on the lines above it, is the field's docstring."""

    def on_attribute_instance(
        self, *, node: ast.AST | griffe.ObjectNode, attr: griffe.Attribute, **kwargs: Any
    ) -> None:
        """Set the docstring of a field that has none."""
        if attr.docstring or not isinstance(node, ast.AnnAssign) or attr.lineno is None:
            return
        lines = attr.lines_collection[Path(str(attr.filepath))]
        first, last = attr.lineno - 1, attr.endlineno or attr.lineno
        above = first
        while lines[above - 1].lstrip().startswith("#"):
            above -= 1
        found = [
            match[0].strip()
            for line in (*lines[above:first], lines[last - 1])
            if (match := _COMMENT.search(line))
        ]
        if found:
            attr.docstring = griffe.Docstring(" ".join(found), parent=attr)
