"""Generated performers with stretched arms, and what the search finds in their voxels."""

import pytest

from tasks.body.initial.search import (
    find_initial_model,
)
from tests.figures.initial_figures import (
    GRID,
    figure_of,
    runs_of,
    stretched_body,
)


@pytest.fixture(scope="module")
def stretched():
    return stretched_body()


@pytest.fixture(scope="module", params=["fitting", "kimono"])
def figure(request, stretched):
    return figure_of(stretched, request.param)


@pytest.fixture(scope="module")
def found(figure):
    return find_initial_model(runs_of(figure.occupied), GRID, 30.0, surfaces=figure.surfaces)
