"""The addresses of pictures: a take's films beside the body, and a view from no camera."""

import tempfile
from pathlib import Path
from typing import Literal

from fastapi import FastAPI, Response
from fastapi.responses import JSONResponse

from storage.archive import Take
from storage.errors import InputError
from tasks.exporting.models import export_voxel_clip
from tasks.rendering.views import CameraPath, render_take
from viewer.addresses.telling import saved_as, told
from viewer.films import BLOCK, Films, film_pictures, open_films
from viewer.holdings import Holdings

_VIEW_PX = (1280, 960)
"""Columns and rows of a novel view [px]. Chosen: a picture for a page of text."""
_KEPT = "private, max-age=600"  # films may be put back, or taken away


def add_pictures(app: FastAPI, holdings: Holdings) -> None:
    """Add the addresses of `holdings` to an app."""

    @app.get("/films/{name}/{version}")
    def films(name: str, version: str) -> Response:
        return told(lambda: JSONResponse(_about(holdings, holdings.take(name, version))))

    @app.get("/films/{name}/{version}/{frame}")
    def film(name: str, version: str, frame: int, camera: str = "") -> Response:
        return told(lambda: _film(holdings, holdings.take(name, version), frame, camera or None))

    @app.get("/view/{name}/{frame}")
    def view(
        name: str, frame: int, azimuth: float, elevation: float,
        color: Literal["video", "segments"] = "video",
    ) -> Response:  # fmt: skip
        path = CameraPath(azimuth=azimuth, elevation=elevation)
        return told(lambda: _view(holdings, name, frame, path, color))

    @app.get("/voxels/{name}/{first}-{last}.glb")
    def voxels(name: str, first: int, last: int) -> Response:
        return told(lambda: _voxels(holdings, name, first, last))


def _about(holdings: Holdings, take: Take) -> dict[str, object]:
    """Return what a page is told of films; where there are none to see, why."""
    try:
        films = _films(holdings, take)
    except InputError as error:  # usual: a capture may be kept elsewhere
        return {"cameras": [], "columns": 1, "why": str(error)}
    return {"cameras": films.cameras, "columns": films.columns, "why": ""}


def _films(holdings: Holdings, take: Take) -> Films:
    return holdings.films(take, lambda: open_films(take))


def _film(holdings: Holdings, take: Take, frame: int, camera: str | None) -> Response:
    """Return the picture of one frame; its neighbors are then at hand."""
    if not 0 <= frame < take.record.frames:
        raise InputError(f"take {take.name!r} has the frames 0-{take.record.frames - 1}")
    films, start = _films(holdings, take), frame - frame % BLOCK
    pictures = holdings.film_pictures(
        (take.name, take.record.version, start, camera or ""),
        lambda: film_pictures(films, start, camera),
    )
    if frame - start >= len(pictures):
        raise InputError(f"the films have no frame {frame}")
    head = {"cache-control": _KEPT}
    return Response(pictures[frame - start], media_type="image/jpeg", headers=head)


def _view(
    holdings: Holdings, name: str, frame: int, path: CameraPath, color: Literal["video", "segments"]
) -> Response:
    """Return what the voxels of a frame look like from somewhere."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "view.png"
        render_take(
            holdings.location, name, str(file), frames=(frame, frame), path=path, size=_VIEW_PX,
            color=color,
        )  # fmt: skip
        return Response(
            file.read_bytes(), media_type="image/png", headers=saved_as(f"{name}-{frame}.png")
        )


def _voxels(holdings: Holdings, name: str, first: int, last: int) -> Response:
    """Return the colored voxels of a short clip as a scene."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "voxels.glb"
        export_voxel_clip(holdings.location, name, str(file), (first, last))
        return Response(
            file.read_bytes(), media_type="model/gltf-binary",
            headers=saved_as(f"{name}-{first}-{last}.glb"),
        )  # fmt: skip
