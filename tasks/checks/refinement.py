"""What the silhouettes say of where the cameras stand: in words, and as a calibration to take."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from storage.formats.calibration.toml import write_calibration
from storage.formats.capture.capture import Capture
from tasks.capture.films import projection_of
from tasks.capture.refining import refine_cameras
from tasks.capture.tangency import WIDTH_PX, Outline

_WORTH_PX = 0.6
"""From how far a camera's planes are off on, its calibration is worth being mended [px of a picture
`WIDTH_PX` wide]. They are off by 0.2 to 0.4 where cameras stand where the calibration says; of one
that is turned by a degree by 3."""
_BETTER = 0.6
"""To which share of that the worst camera has to come [share]. Chosen: where silhouettes are at
fault, moving cameras does not help."""
_FILE = "calibration.toml"


@dataclass(frozen=True)
class Refinement:
    """What was found."""

    lines: tuple[str, ...]
    """Of a report: a table of the cameras, and what to do."""
    path: Path | None = None
    """The calibration that was written, where it is better."""


def refine_capture(capture: Capture, outlines: Sequence[Outline], into: Path) -> Refinement:
    """Move a capture's cameras to where its silhouettes have them, and say by how much.

    The capture is left as it is.

    Parameters
    ----------
    capture
        With its cameras.
    outlines
        Of each camera, of the same moments.
    into
        The folder for the calibration.

    Raises
    ------
    OSError
        If that cannot be written.
    """
    found = refine_cameras(outlines, projection_of(capture.cameras))
    if found is None:
        return Refinement(
            ("the cameras cannot be refined: their silhouettes are seen together too seldom",)
        )
    lines = [f"{'refined':16} {'off px':>7} {'then':>6} {'moved mm':>9} {'turned deg':>11}"]
    for n, camera in enumerate(capture.cameras):
        lines.append(
            f"{camera.name:16} {found.before_px[n]:7.2f} {found.after_px[n]:6.2f} "
            f"{1000 * found.moved_m[n]:9.0f} {found.turned_deg[n]:11.2f}"
        )
    own_px = np.array([camera.width for camera in capture.cameras]) / WIDTH_PX
    before, after = (float((px / own_px).max()) for px in (found.before_px, found.after_px))
    if before < _WORTH_PX:
        lines.append(
            "the cameras stand where the silhouettes say, as well as these can tell: nothing was "
            "written"
        )
        return Refinement(tuple(lines))
    if after > _BETTER * before:
        lines.append(
            "no place of the cameras agrees better with the silhouettes: look at these; nothing "
            "was written"
        )
        return Refinement(tuple(lines))
    moved = [
        replace(camera, rotation=pose[:, :3], translation=pose[:, 3])
        for camera, pose in zip(capture.cameras, found.projection.camera_from_world, strict=True)
    ]
    into.mkdir(parents=True, exist_ok=True)
    write_calibration(into / _FILE, moved)
    lines.append(
        f"refined cameras: {into / _FILE}, in metres with y up; to take them, put it in place of "
        f"{capture.calibration.name}, and take what says otherwise out of [video]"
    )
    return Refinement(tuple(lines), into / _FILE)
