"""`make test` tests the rules of Deep RTS in plain Python, `make test-all` compiled too.

They are short games of many kinds, which plain Python plays at once; that compiled code plays the
same bits is tested for all games. Tests of maps need no rules.
"""

from pathlib import Path

import pytest

from marl_cair.games.compiled import is_compiling
from marl_cair.games.deep_rts.tables import PRESETS
from tests.games.deep_rts.skirmish import DRILL

HERE = Path(__file__).parent
WITHOUT_RULES = {"test_maps", "test_map_formats", "test_map_generator"}


def pytest_collection_modifyitems(items):
    mark = pytest.mark.slow if is_compiling() else pytest.mark.plain_python
    for item in items:
        if item.path.parent == HERE and item.path.stem not in WITHOUT_RULES:
            item.add_marker(mark)


@pytest.fixture(scope="module", autouse=True)
def _drill():
    """Adds the preset `drill`, for the tests of this folder only."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(PRESETS, "drill", DRILL)
        yield
