"""While Deep RTS is a preview, `make test` plays its rules in plain Python, `test-all` compiled.

Compiling them takes minutes, plain Python plays the same bits at once. Tests of maps need neither.
"""

from pathlib import Path

import pytest

from marl_cair.games.compiled import is_compiling

HERE = Path(__file__).parent
WITHOUT_RULES = {"test_maps", "test_map_formats", "test_map_generator"}


def pytest_collection_modifyitems(items):
    mark = pytest.mark.slow if is_compiling() else pytest.mark.plain_python
    for item in items:
        if item.path.parent == HERE and item.path.stem not in WITHOUT_RULES:
            item.add_marker(mark)
