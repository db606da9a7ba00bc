"""A small filmed capture that begins with the arms stretched."""

from pathlib import Path

from tasks.studio.cameras import RingSettings, generate_cameras
from tasks.studio.dancing.openings import stretch_arms_first
from tasks.studio.filming import FilmSettings, film_capture
from tests.conftest import swaying_body


def film_posed(folder: Path, *, frames: int = 12) -> Path:
    """Film a swaying body with six small cameras into a folder; return it."""
    track = stretch_arms_first(swaying_body(3, 30), 30.0)[:frames]
    cameras = generate_cameras(
        RingSettings(cameras=6, size=(160, 120)), center_m=(0.0, 0.9, 0.0), seed=4
    )
    film_capture(folder, track, 30.0, cameras=cameras, settings=FilmSettings(voxel_m=0.025), seed=2)
    return folder
