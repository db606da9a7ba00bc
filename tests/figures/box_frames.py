"""A take of boxes of voxels, as the stages after coloring read it."""

import numpy as np

from tasks.geometry.voxels import VoxelGrid, encode_runs, voxel_index

GRID = VoxelGrid((0.0, 0.0, 0.0), 0.1, (30, 20, 10))


class Frames:
    """Hulls and voxels of frames that are boxes: (low, high) corners."""

    grid = GRID

    def __init__(self, *boxes):
        self._boxes = boxes

    def __len__(self):
        return len(self._boxes)

    def hull(self, frame):
        occupied = np.zeros((1, *GRID.shape), bool)
        for low, high in self._boxes[frame]:
            occupied[0, low[0] : high[0], low[1] : high[1], low[2] : high[2]] = True
        return encode_runs(occupied)

    def index(self, frame):
        return voxel_index(self.hull(frame), 0)
