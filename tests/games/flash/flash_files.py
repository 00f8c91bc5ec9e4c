"""Flash files of tests, and what playing them needs, skipped when it is not installed."""

from pathlib import Path

import pytest

from marl_cair.games.flash.installing import diagnose
from tests.games.flash.vnc_servers import IS_NEEDED

PROBE = Path(__file__).parent / "probe" / "probe.swf"  # see Probe.hx
SIZE = (480, 360)


def need_flash() -> None:
    missing = diagnose()
    if missing:
        reason = ", ".join(f"{part.name} is missing: {part.command}" for part in missing)
        if IS_NEEDED:
            pytest.fail(reason)
        pytest.skip(reason)
