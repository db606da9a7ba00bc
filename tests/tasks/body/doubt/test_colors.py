"""What a limb wears is learned from the take, and tells a limb that is elsewhere."""

import numpy as np
import pytest

from tasks.body.anatomy.bones import BONES
from tasks.body.anatomy.colors import color_cells
from tasks.body.doubt.colors import tell_unlike
from tasks.body.poses.limbs import LIMBS

FRAMES, RATE_HZ, LOST = 90, 10.0, slice(40, 48)
SKIN, SLEEVE, SOCK = color_cells(np.array([(220, 170, 140), (110, 30, 120), (235, 235, 235)], "u1"))
WORN = {"Hand": SKIN, "ForeArm": SLEEVE, "Foot": SOCK, "LowerLeg": SLEEVE, "Body": SLEEVE}


def take(frames=FRAMES, *, lost=LOST, swapped=False):
    """Return bones and cells of voxels, eight of a bone; a right hand is lost in a sleeve."""
    names = [name for name in BONES if name.lstrip("RL") in WORN or name[1:] in WORN]
    bone = np.repeat([BONES.index(name) for name in names], 8).astype(np.int8)
    cell = np.repeat([WORN[name if name in WORN else name[1:]] for name in names], 8)
    bones, cells = [bone] * frames, [cell] * frames
    for t in range(frames)[lost]:
        cells[t] = np.where(bone == LIMBS[0].end, SLEEVE, cell)
    if swapped:  # voxels in any order
        order = np.random.default_rng(2).permutation(len(bone))
        bones, cells = [b[order] for b in bones], [c[order] for c in cells]
    return bones, cells


@pytest.mark.parametrize("swapped", [False, True])
def test_a_hand_that_wears_a_sleeve_is_unlike(swapped):
    found = tell_unlike(*take(swapped=swapped), RATE_HZ)
    lost = np.zeros((FRAMES, 4), bool)
    lost[LOST, 0] = True
    assert found["unlike_end"][lost].min() > 1.0
    assert found["unlike_end"][~lost].max() < 0.2
    assert found["unlike_lower"].max() < 0.2


def test_a_limb_does_not_vouch_for_itself():
    """A hand lost in as many frames as are left out is told from all others."""
    found = tell_unlike(*take(lost=slice(40, 60)), RATE_HZ)
    assert found["unlike_end"][40:60, 0].min() > 1.0


def test_colors_that_are_not_known_tell_nothing():
    bones, cells = take()
    found = tell_unlike(bones, [np.full_like(cell, -1) for cell in cells], RATE_HZ)
    assert not found["unlike_end"].any()
    nobody = tell_unlike([np.zeros(0, np.int8)] * 5, [np.zeros(0, np.int32)] * 5, RATE_HZ)
    assert nobody["unlike_lower"].shape == (5, 4)
    assert not nobody["unlike_lower"].any()


def test_a_take_of_a_moment_tells_nothing():
    found = tell_unlike(*take(8, lost=slice(2, 5)), RATE_HZ)
    assert not found["unlike_end"].any()
