"""Fewer bootstrap resamples outside tests of ratings, and time to start for a loaded machine."""

import pytest

from marl_cair.league.agents import process
from marl_cair.league.ratings import rate


@pytest.fixture(scope="module", autouse=True)
def _fast_and_patient(request):
    """Fewer resamples change only the ends of intervals."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(process, "START_SECONDS", 600.0)
        if request.path.parent.name != "ratings":
            patch.setattr(rate, "MOST_RESAMPLES", rate.LEAST_RESAMPLES)
        yield
