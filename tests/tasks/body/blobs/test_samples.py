"""Samples of voxels have the colors of their own voxels."""

import numpy as np
import pytest

from tasks.body.anatomy.bones import BONES
from tasks.body.anatomy.colors import color_cells
from tasks.body.blobs.samples import draw_samples, learn_looks
from tasks.geometry.voxels import encode_runs


@pytest.fixture
def take():
    """Two frames and an empty one: occupied voxels, and surfaces with colors of their own."""
    rng = np.random.default_rng(8)
    occupied = rng.random((3, 7, 9, 5)) < 0.5
    occupied[2] = False
    frames = []
    for frame in occupied:
        is_surface = rng.random(int(frame.sum())) < 0.6
        color = rng.integers(0, 256, (int(is_surface.sum()), 3)).astype(np.uint8)
        camera = rng.choice([0, 3, 255], len(color)).astype(np.uint8)
        frames.append((is_surface, color, camera))
    return occupied, frames


def test_each_voxel_has_its_own_color(take):
    occupied, frames = take
    drawn = draw_samples(
        [encode_runs(each[None]) for each in occupied], lambda frame: frames[frame], 40
    )
    known = 0
    for frame, (index, cell) in enumerate(drawn):
        is_surface, color, camera = frames[frame]
        place = {tuple(voxel): n for n, voxel in enumerate(np.argwhere(occupied[frame]).tolist())}
        for voxel, found in zip(index.tolist(), cell, strict=True):
            n = place[tuple(voxel)]
            own = int(is_surface[:n].sum())
            if is_surface[n] and camera[own] != 255:
                assert found == color_cells(color[own : own + 1])[0]
                known += 1
            else:
                assert found == -1
    assert 20 < known < sum(len(cell) for _, cell in drawn)
    assert [len(index) for index, _ in drawn][2] == 0
    assert all(40 <= len(index) < 90 for index, _ in drawn[:2])


def test_without_surfaces_no_color_is_known(take):
    occupied, _ = take
    drawn = draw_samples([encode_runs(each[None]) for each in occupied], None, 40)
    assert (np.concatenate([cell for _, cell in drawn]) == -1).all()
    looks = learn_looks(np.zeros(0, int), None, 0, 5.0)
    assert (looks == 1).all()


def test_what_is_not_known_and_what_is_not_the_bodys_says_nothing(take):
    occupied, frames = take
    bone = np.arange(int(occupied[0].sum())) % len(BONES)
    looks = learn_looks(bone, lambda frame: frames[frame], 0, 5.0)
    assert looks.shape[1] == len(BONES) + 1
    assert (looks[-1] == 1).all()
    assert (looks[:, -1] == 1).all()
    left, right = BONES.index("LHand"), BONES.index("RHand")
    np.testing.assert_array_equal(looks[:, left], looks[:, right])
    assert looks[:, :-1].std() > 0


def test_a_sample_goes_along_the_z_order_curve(take):
    occupied, _ = take
    index, _ = draw_samples([encode_runs(each[None]) for each in occupied], None, 1000)[0]

    def interleaved(voxel):
        bits = "".join(
            f"{z:010b}"[n] + f"{y:010b}"[n] + f"{x:010b}"[n]
            for n in range(10)
            for x, y, z in [voxel]
        )
        return int(bits, 2)

    far = [interleaved(voxel) for voxel in index.tolist()]
    assert far == sorted(far)
    assert len(set(far)) == int(occupied[0].sum())
