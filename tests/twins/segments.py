"""The kinematics of the eleven segments, written down a second time."""

import numpy as np

PARENT = {1: 0, 2: 1, 3: 1, 4: 3, 5: 1, 6: 5, 7: 2, 8: 7, 9: 2, 10: 9}
"""The segment that each segment hangs on; the head, 0, hangs on none (Table 1)."""


def pose_in_world(position, rotation):
    """Return each segment's joint position and rotation in the world, from those in its parent.

    Positions are (..., 11, 3), rotations (..., 11, 3, 3); those of the head are in the world.
    """
    world, turn = np.array(position, float), np.array(rotation, float)
    for segment, parent in PARENT.items():
        way = (turn[..., parent, :, :] @ position[..., segment, :, None])[..., 0]
        world[..., segment, :] = world[..., parent, :] + way
        turn[..., segment, :, :] = turn[..., parent, :, :] @ rotation[..., segment, :, :]
    return world, turn
