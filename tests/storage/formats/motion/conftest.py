"""A C3D file that we wrote, to be read and to be spoiled."""

import struct

import numpy as np
import pytest

from storage.formats.motion.c3d import write_c3d


@pytest.fixture
def rng():
    return np.random.default_rng(12)


@pytest.fixture
def written(tmp_path, rng):
    """A file of ours: 5 frames, 4 markers, one gap."""
    position = rng.normal(0, 1, (5, 4, 3))
    position[2, 1] = np.nan
    write_c3d(tmp_path / "ours.c3d", position, ["RHip", "LHip", "Neck", "Head"], 60.0)
    return tmp_path / "ours.c3d", position


def change(data, name, content):
    """The file with the value of a parameter of POINT replaced."""
    at = data.index(name.encode() + struct.pack("<H", len(content) + 5)) + len(name) + 4
    return data[:at] + content + data[at + len(content) :]
