"""Pieces that are told from runs alone are those of the dense voxels."""

import numpy as np
import pytest
from scipy import ndimage

from tasks.geometry.voxels import encode_runs, voxel_index
from tasks.reconstruction.regions.pieces import pieces_of_runs


@pytest.mark.parametrize("edge", [1, 2, 3])
@pytest.mark.parametrize("share", [0.002, 0.02, 0.1])
def test_pieces_of_runs_are_those_of_the_cells(share, edge):
    hull = encode_runs(np.random.default_rng(edge).random((1, 23, 31, 26)) < share)
    cell = voxel_index(hull, 0) // edge
    cells = np.zeros((24, 32, 27), np.bool_)
    cells[tuple(cell.T)] = True
    wanted = ndimage.label(cells, np.ones((3, 3, 3)))[0][tuple(cell.T)]
    found = np.repeat(pieces_of_runs(hull, edge), hull.length)
    pairs = np.unique(np.stack([wanted, found]), axis=1)
    assert len(pairs.T) == len(set(wanted)) == len(set(found))


def test_an_empty_frame_has_no_pieces():
    assert not len(pieces_of_runs(encode_runs(np.zeros((1, 3, 3, 3), np.bool_)), 3))
