"""Fewer bootstrap resamples in tests of leagues and reports; tests of ratings keep all of them."""

import pytest

from marl_cair.league.ratings import rate


@pytest.fixture(scope="module", autouse=True)
def _few_resamples(request):
    """Only ends of intervals move by it."""
    with pytest.MonkeyPatch.context() as patch:
        if request.path.parent.name != "ratings":
            patch.setattr(rate, "MOST_RESAMPLES", rate.LEAST_RESAMPLES)
        yield
