"""Write a take's voxels and segments for other programs: PLY, CSV, JSON.

The paper's purpose: each segment's shape and movement as information of its own. And what the
segments were measured by, as `initial.json` for whoever wants to correct it.
"""

import csv
import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray
from numpy.typing import NDArray

from storage import open_archive
from storage.archive import Take, nearest
from storage.errors import InputError, UnknownNameError
from storage.files import write_beside
from storage.formats.capture.initial import write_initial
from storage.formats.pictures.pictures import write_png
from storage.formats.pictures.ply import write_points, write_surface
from storage.places import told
from storage.schema import SEGMENTS
from tasks.body.anatomy.shape import segment_motion
from tasks.body.initial.search import InitialModel, label_from_joints
from tasks.exporting.surfaces import closed_surface, nearest_colors
from tasks.geometry.voxels import VoxelGrid, encode_runs
from tasks.rendering.initial_model import draw_initial_model

_MOTION_COLUMNS = (
    *("time_s", "x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"),
    *("vx_m_s", "vy_m_s", "vz_m_s", "wx_rad_s", "wy_rad_s", "wz_rad_s"),
)


def export_voxels(
    archive: str,
    take: str,
    file: str,
    *,
    frame: int | None = None,
    mesh: bool = False,
    segment: str | None = None,
) -> list[str]:
    """Write the voxels of a frame, or of one segment of it, as PLY; return what was written.

    Parameters
    ----------
    frame
        By default the middle of the take.
    mesh
        A closed surface of triangles instead of points with color and label.
    segment
        Only the voxels of this segment.

    Raises
    ------
    UnknownNameError, ArchiveError, InputError
        If the take, frame or segment is not there, nothing is occupied, or the file cannot be
        written.
    """
    opened = open_archive(archive).take(take)
    count = opened.record.frames
    frame = count // 2 if frame is None else frame
    if frame >= count:
        raise InputError(f"take {take!r} has the frames 0-{count - 1}; {frame} goes beyond")
    voxels = opened.voxels(frame)
    if segment is not None:
        voxels = voxels.isel(voxel=voxels["label"].values == _label_of(opened, segment))
    if not voxels.sizes["voxel"]:
        what = f"of {segment} " if segment else ""
        raise InputError(f"in frame {frame} of take {take!r} no voxel {what}is occupied")
    if mesh:
        vertex, face = _write_mesh(Path(file), voxels)
        return [f"{file}: frame {frame}, {vertex:,} vertices, {face:,} triangles"]
    label = voxels["label"].values if "label" in voxels else np.zeros(voxels.sizes["voxel"], "u1")
    shown = np.ones(len(label), np.bool_) if segment else voxels["is_surface"].values
    write_points(
        file, voxels["center"].values[shown], _colors(voxels)[shown], label[shown].astype(np.uint8)
    )
    return [f"{file}: frame {frame}, {int(shown.sum()):,} voxels"]


def export_segment_motion(
    archive: str, take: str, file: str, segment: str, *, clip: tuple[int, int] | None = None
) -> list[str]:
    """Write how a segment moves as CSV, a line a frame; return what was written.

    Place of its joint, rotation as a quaternion, velocity and angular velocity, in the world.

    Raises
    ------
    UnknownNameError, ArchiveError, InputError, PlaceError
        If the take, the segment or the clip is not there, or the file cannot be written.
    """
    opened = open_archive(archive).take(take)
    number = _label_of(opened, segment) - 1
    first, last = clip or (0, opened.record.frames - 1)
    if last >= opened.record.frames or last == first:
        raise InputError(
            f"take {take!r} has the frames 0-{opened.record.frames - 1}; a motion needs two or "
            f"more of them, not {first}-{last}"
        )
    pose = opened.pose.isel(time=slice(first, last + 1))
    motion = segment_motion(
        pose["time"].values, pose["position"].values, pose["rotation"].values, number
    )
    rows = np.column_stack(
        [
            *(motion.time_s, motion.position, motion.quaternion),
            *(motion.velocity, motion.angular_velocity),
        ]
    )
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_MOTION_COLUMNS)
    writer.writerows([[f"{value:.6g}" for value in row] for row in rows])
    with told(f"write {file}"):
        write_beside(Path(file), text.getvalue().encode())
    return [f"{file}: {len(rows)} frames of {segment}"]


def export_initial(archive: str, take: str, file: str) -> list[str]:
    """Write what a take's body was measured by as `initial.json`; return what was written.

    The joints and their frame, to be corrected and put into the capture, and beside the file a
    picture of them in the labeled voxels. Labels are left out: of corrected joints they are made
    anew.

    Raises
    ------
    UnknownNameError, ArchiveError, InputError, PlaceError
        If the take is not there or has no body, or a file cannot be written.
    """
    opened = open_archive(archive).take(take)
    path = Path(file)
    picture = picture_initial(opened)
    body = opened.body
    frame, confidence = body.attrs["initial_frame"], body.attrs["confidence"]
    with told(f"write {path}"):
        write_initial(path, body["initial_joint"].values, frame=frame)
    write_png(path.with_suffix(".png"), picture)
    return [
        f"{path}: the joints of frame {frame}, with a confidence of {confidence:.2f}",
        f"{path.with_suffix('.png')}: its picture",
    ]


def picture_initial(take: Take) -> NDArray[np.uint8]:
    """Return the picture (480, 960, 3) of the joints that a take's body was measured by.

    Raises
    ------
    InputError
        If the take has no body.
    """
    if "body" not in take.record.stages:
        raise InputError(f"take {take.name!r} has no initial model: its pose was not fitted")
    body, frame = take.body, int(take.body.attrs["initial_frame"])
    attributes = take.voxels(frame).attrs
    grid = VoxelGrid(
        tuple(attributes["origin_m"]), attributes["voxel_m"], tuple(attributes["shape"])
    )
    hull = encode_runs(take.occupied(frame).values[None])
    before = np.zeros(frame, np.int64)  # frames with nobody, so that the numbers are the take's
    runs = replace(hull, offset=np.concatenate([before, hull.offset]))
    position = body["initial_joint"].values
    label = label_from_joints(runs, grid, frame, position)
    model = InitialModel(frame, position, label, float(body.attrs["confidence"]), ())
    return draw_initial_model(model, runs, grid)


def _label_of(take: Take, segment: str) -> int:
    """Return the label of a segment of a take that has labels."""
    if segment not in SEGMENTS:
        raise UnknownNameError(
            f"there is no segment {segment!r}{nearest(segment, SEGMENTS)}; the segments are "
            f"{', '.join(SEGMENTS)}"
        )
    if "labels" not in take.record.stages:
        raise InputError(f"take {take.name!r} has no segments: its pose was not fitted")
    return SEGMENTS.index(segment) + 1


def _colors(voxels: xarray.Dataset) -> NDArray[np.uint8]:
    """Return a color for every voxel: inside, the nearest one's of the surface."""
    color, is_surface = voxels["color"].values, voxels["is_surface"].values
    if is_surface.all() or not is_surface.any():
        return color
    center = voxels["center"].values
    filled = color.copy()
    filled[~is_surface] = nearest_colors(center[~is_surface], center[is_surface], color[is_surface])
    return filled


def _write_mesh(path: Path, voxels: xarray.Dataset) -> tuple[int, int]:
    """Write the surface of voxels; return how many vertices and triangles it has."""
    vertex, face = closed_surface(
        voxels["index"].values, voxels.attrs["origin_m"], voxels.attrs["voxel_m"]
    )
    color = nearest_colors(vertex, voxels["center"].values, _colors(voxels))
    write_surface(path, vertex, color, face)
    return len(vertex), len(face)
