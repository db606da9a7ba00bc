"""The sub-commands that show voxels, and `plan`, which shows where they can be."""

import argparse
import math
import re
import sys
from collections.abc import Callable
from pathlib import Path

from flows.command import printing

_DIRECTION = {"azimuth": 30.0, "elevation": 12.0, "orbit": 0.0}
"""Where a view is from: two angles [deg], and turns over a film. Chosen by eye."""
_LARGEST = 1_000_000_000
"""The largest number that an option may have. Longer ones mean nothing, and fill the screen."""
_SHOWN = 40
"""How much of such a number is shown [characters]."""


def add_render_options(command: argparse.ArgumentParser) -> None:
    """Add what `shosa render` understands."""
    command.add_argument("archive", metavar="ARCHIVE")
    command.add_argument("take", metavar="TAKE")
    command.add_argument("file", metavar="FILE", help=".png, or .mp4 (MPEG-4 part 2)")
    command.add_argument("--frame", type=int, metavar="N", help="of a still; default the middle")
    command.add_argument("--frames", metavar="START-END", help="of a film; default the whole take")
    command.add_argument(
        "--azimuth", type=float, metavar="DEGREES",
        help="from where: 0 from +Z, 90 from +X (default 30)",
    )  # fmt: skip
    command.add_argument(
        "--elevation", type=float, metavar="DEGREES", help="above the horizon (default 12)"
    )
    command.add_argument(
        "--orbit", type=float, metavar="TURNS", help="times around, over a film (default 0)"
    )
    command.add_argument("--camera", metavar="NAME", help="look from this camera of the capture")
    command.add_argument("--size", default="960x720", metavar="WxH")
    command.add_argument("--color", choices=("video", "segments"), default="video")


def render(options: argparse.Namespace, clip: tuple[int, int] | None) -> None:
    """Run `shosa render`; `clip` is what `--frames` says.

    Raises
    ------
    ValueError
        If options have values that mean nothing.
    """
    from tasks.rendering.views import CameraPath, render_take

    found = re.fullmatch(r"([0-9]{2,4})x([0-9]{2,4})", options.size)
    if not found or not (16 <= int(found[1]) <= 8192 and 16 <= int(found[2]) <= 8192):
        raise ValueError(
            f"--size {options.size[:_SHOWN]} should be WxH, such as 960x720, each from 16 to 8192"
        )
    if options.frame is not None and not 0 <= options.frame <= _LARGEST:
        raise ValueError(
            f"--frame {str(options.frame)[:_SHOWN]} should be 0 or more, and {_LARGEST:,} at most"
        )
    _check_together(options)
    frames = (options.frame, options.frame) if options.frame is not None else clip
    path = CameraPath(
        math.radians(_DIRECTION["azimuth"] if options.azimuth is None else options.azimuth),
        math.radians(_DIRECTION["elevation"] if options.elevation is None else options.elevation),
        _DIRECTION["orbit"] if options.orbit is None else options.orbit,
        options.camera,
    )
    said = render_take(
        options.archive, options.take, options.file, frames=frames, path=path,
        size=(int(found[1]), int(found[2])), color=options.color, tell=_progress(),
    )  # fmt: skip
    printing.say(said)


def _check_together(options: argparse.Namespace) -> None:
    """Refuse numbers that are none, and options that mean nothing together, with a ValueError."""
    given = [name for name in _DIRECTION if getattr(options, name) is not None]
    if any(not abs(getattr(options, name)) <= _LARGEST for name in given):
        raise ValueError(
            f"--azimuth, --elevation and --orbit should be numbers, up to {_LARGEST:,}"
        )
    if options.camera is not None and given:
        raise ValueError(f"--camera is a place to look from: leave out --{', --'.join(given)}")
    if options.frame is not None and options.frames is not None:
        raise ValueError("--frame is of a still and --frames of a film: leave out one of them")
    is_film = Path(options.file).suffix.lower() == ".mp4"
    if is_film and options.frame is not None:
        raise ValueError("--frame is of a still; a film is of --frames START-END")
    if not is_film and options.orbit:
        raise ValueError("--orbit is of a film, and a still has one place: give --azimuth")


def export_voxels_or_segment(
    options: argparse.Namespace, clip: tuple[int, int] | None
) -> list[str] | None:
    """Export what is not joints where the options ask for it; return what was written."""
    from tasks.exporting.voxels import export_initial, export_segment_motion, export_voxels

    suffix = Path(options.file).suffix.lower()
    if options.voxels:
        from tasks.exporting.models import export_voxel_clip

        if suffix != ".glb" or clip is None or options.mesh or options.segment:
            raise ValueError("--voxels is for a .glb file of some --frames START-END, and no more")
        return export_voxel_clip(options.archive, options.take, options.file, clip)
    if suffix == ".ply":
        if clip and clip[0] != clip[1]:
            raise ValueError(f"a PLY file holds one frame: --frames {clip[0]}-{clip[0]}")
        return export_voxels(
            options.archive, options.take, options.file,
            frame=clip[0] if clip else None, mesh=options.mesh, segment=options.segment,
        )  # fmt: skip
    if suffix == ".json":
        if clip or options.mesh or options.segment:
            raise ValueError(
                "an initial model is of one frame and of all segments: leave out --frames, "
                "--mesh and --segment"
            )
        return export_initial(options.archive, options.take, options.file)
    if options.mesh:
        raise ValueError("--mesh is for PLY files; give FILE the suffix .ply")
    if options.segment is None:
        return None
    if suffix != ".csv":
        raise ValueError("a segment is written as .ply (its voxels) or .csv (its motion)")
    return export_segment_motion(
        options.archive, options.take, options.file, options.segment, clip=clip
    )


def plan(options: argparse.Namespace) -> None:
    """Run `shosa plan`.

    Raises
    ------
    InputError
        If it is no plan, or has too few cameras.
    """
    from storage.errors import InputError
    from storage.formats.capture.camera_plan import read_camera_plan
    from tasks.checks.layouts import judge_layout, report_layout

    cameras, volume, notes = read_camera_plan(Path(options.cameras))
    if len(cameras) < 3:
        raise InputError(f"{options.cameras} has {len(cameras)} cameras; a hull needs 3 or more")
    report = judge_layout(cameras, volume)
    for note in notes:
        printing.say(note)
    if options.json:
        printing.print_json(
            {
                "cameras": list(report.names),
                "seen_by": report.seen_by.tolist(),
                "share": report.share.tolist(),
                "pixel_mm": [None if math.isnan(p) else 1000 * p for p in report.pixel_m],
                "excess": report.excess.tolist(),
                "excess_without": [None if math.isnan(e) else e for e in report.excess_without],
                "lost": report.lost.tolist(),
            }
        )
        return
    for line in report_layout(report):
        printing.print_line(line)


def _progress() -> Callable[[int, int], None]:
    """Return what shows how far a film is, on a terminal."""
    if not sys.stderr.isatty():
        return lambda _done, _total: None

    def tell(done: int, total: int) -> None:
        sys.stderr.write(f"\r{done}/{total} frames" + "\n" * (done == total))
        sys.stderr.flush()

    return tell
