"""Follow a body through the frames around one that it was fitted to.

A single frame tells badly which way a foot points, or which leg is which. Frames on end do: knees
bend one way, and what is seen of hands, face and feet is followed.
"""

from dataclasses import dataclass

import numpy as np

from storage.schema import JOINTS
from tasks.body.anatomy.bones import BONES, Floats, Pose
from tasks.body.anatomy.nearest_bones import bones_of_voxels, label_points
from tasks.body.anatomy.proportions import complete_joints
from tasks.body.anatomy.skin import SurfaceFrame
from tasks.body.blobs.samples import draw_samples, learn_looks
from tasks.body.extremities.faces import initial_places
from tasks.body.extremities.places import Extremities, find_extremities
from tasks.body.guess.single_frames import Shown, forward
from tasks.body.guess.usual_body import UsualBody
from tasks.body.poses.joint import RIDES_ON, fit_in_passes, fit_poses
from tasks.body.poses.passes import Fitting
from tasks.body.poses.settings import JointMethodSettings
from tasks.motion.stature import take_stature

_RIDES = np.array([BONES.index(RIDES_ON[name]) for name in JOINTS])


@dataclass(frozen=True, eq=False)
class Track:
    """A body that was measured in a frame, in all frames."""

    frame: int
    """The frame."""

    initial: Floats
    """(21, 3) its joints there, m."""

    position: Floats
    """(time, 21, 3) its joints, m."""

    rotation: Floats
    """(time, 21, 3, 3) how the bone that carries each joint is turned since that frame."""

    def moved_to(self, position: Floats) -> dict[str, Floats]:
        """Return the joints (3,) of the body's frame that lie, in most frames, at other places.

        `position` is (time, 21, 3), m.
        """
        off = np.einsum("tkji,tkj->tki", self.rotation, position - self.position)
        return dict(zip(JOINTS, self.initial + np.median(off, axis=0), strict=True))


def follow_usual_body(
    shown: Shown, rate_hz: float, frame: int, pose: Pose, body: UsualBody
) -> Floats:
    """Return (time, 21, 3) the joints, m, of a body whose pose in a frame is known.

    Its joints stay where proportions put them: where its bones seem to turn is that of clothes.
    """
    joints = body.place(pose)
    seen = _see(shown, rate_hz, frame, joints, body.stature_m)
    ends = {**joints, "Hips": (joints["RHip"] + joints["LHip"]) / 2.0}
    point = shown.points(frame)
    label = label_points(point, complete_joints(joints))
    settings = JointMethodSettings(joint_rounds=0)
    feet = [(body.joints[side + "Heel"] + body.joints[side + "Foot"]) / 2.0 for side in "RL"]
    take = Fitting(
        shown.grid,
        rate_hz,
        body.blobs,
        settings,
        placed=np.concatenate([initial_places(body.joints, body.stature_m), feet]),
        samples=draw_samples(shown.hulls, shown.surfaces, settings.sample),
        looks=learn_looks(
            bones_of_voxels(point, label, ends, forward(pose)),
            shown.surfaces, frame, settings.most_likeness,
        ),
        cues=_places(seen), cue_weights=_weights(seen),
    )  # fmt: skip
    account, _ = fit_in_passes(take, frame, pose, seen.hand_ends)
    return np.array([list(body.place(fit.pose).values()) for fit in account.fits])


def follow_measured_body(
    shown: Shown, rate_hz: float, frame: int, joints: dict[str, Floats], stature_m: float | None
) -> Track:
    """Return the body that the voxels of a frame make, given its joints (3,) there, m.

    It is what the stage of the poses will make of them.
    """
    position = np.array([joints[name] for name in JOINTS])
    seen = _see(shown, rate_hz, frame, joints, stature_m or take_stature(position[None]))
    label = label_points(shown.points(frame), complete_joints(joints))
    fitted = fit_poses(
        shown.hulls, shown.grid, rate_hz, position, label,
        initial_frame=frame, surfaces=shown.surfaces, hand_ends=seen.hand_ends,
        cues=_places(seen), cue_weights=_weights(seen),
    )  # fmt: skip
    rotation = np.array([pose.rotation[_RIDES] for pose in fitted.poses])
    return Track(frame, fitted.initial, fitted.position, rotation)


def _see(
    shown: Shown, rate_hz: float, frame: int, joints: dict[str, Floats], stature_m: float
) -> Extremities:
    """Return where face, hands and feet are in all frames."""
    surfaces = []
    for n in range(len(shown.hulls)):
        is_surface, color, camera = shown.surfaces(n)
        surfaces.append(SurfaceFrame(shown.points(n)[is_surface], color, camera))
    return find_extremities(surfaces, rate_hz, stature_m, joints, initial_frame=frame)


def _places(seen: Extremities) -> Floats:
    """Return (time, 5, 3) where face, hands and feet were seen, m."""
    return np.concatenate([seen.position, seen.foot], axis=1)


def _weights(seen: Extremities) -> Floats:
    """Return (time, 5) how sure that is."""
    return np.concatenate([seen.weight, seen.foot_weight], axis=1)
