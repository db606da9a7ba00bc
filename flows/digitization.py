"""Captures into takes.

Films -> silhouettes -> visual hulls -> colored voxels -> initial model -> poses -> labels -> index.
"""

import hashlib
import logging
from base64 import b64encode
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from prefect import flow
from prefect.artifacts import (
    create_image_artifact,
    create_markdown_artifact,
    create_progress_artifact,
    create_table_artifact,
    update_progress_artifact,
)

from storage import open_archive
from storage.archive import Take
from storage.blocks import block_path, discard_blocks
from storage.errors import InputError
from storage.formats.capture.capture import read_capture
from storage.formats.pictures.pictures import encode_png
from storage.publication import read_record
from storage.recordings import Recording
from tasks.body.labeling import label_block
from tasks.body.pose_fitting import PosingSettings
from tasks.cached import (
    carve_block_once,
    color_block_once,
    extract_block_once,
    fit_take_once,
    index_take_once,
    label_block_once,
    model_take_once,
)
from tasks.capture.films import block_ranges
from tasks.checks.agreement import check_take
from tasks.engine.fingerprints import fingerprint
from tasks.exporting.voxels import picture_initial
from tasks.reconstruction.carving import CarvingSettings, carve_block
from tasks.reconstruction.coloring import ColoringSettings, color_block
from tasks.reconstruction.silhouettes import SilhouetteSettings, extract_block
from tasks.takes.assembling import Blocks, assemble_take, is_digitized
from tasks.takes.publishing import publish_take

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class DigitizationSettings:
    """The settings of every stage from the films to the labels."""

    silhouettes: SilhouetteSettings = field(default_factory=SilhouetteSettings)
    carving: CarvingSettings = field(default_factory=CarvingSettings)
    coloring: ColoringSettings = field(default_factory=ColoringSettings)
    posing: PosingSettings = field(default_factory=PosingSettings)


@flow(name="digitize_take", flow_run_name="digitize {recording.take}", persist_result=False)
def digitize_take(
    archive: str, recording: Recording, settings: DigitizationSettings | None = None
) -> dict[str, Any]:
    """Take a capture into the archive at `archive`, stage after stage, block after block.

    A run that was killed is gone on with: the blocks that it finished are not computed again.

    Returns
    -------
    dict
        The fields of the take's `Record`, and `published`: False where the archive had it.

    Raises
    ------
    InputError
        If the capture cannot be digitized, with all that is wrong.
    """
    settings = settings or DigitizationSettings()
    identity = _identity(recording, settings)
    opened = open_archive(archive)
    if is_digitized(opened, recording.take, identity):
        return {**asdict(opened.take(recording.take).record), "published": False}
    blocks, notes = _compute_blocks(archive, recording, settings)
    draft = assemble_take(
        archive,
        recording.path,
        recording.digest,
        recording.take,
        blocks,
        settings=asdict(settings),
        identity=identity,
        notes=notes,
    )
    if "motion" in draft["stages"]:
        index_take_once(archive=archive, take=draft["take"], version=draft["version"])
    publish_take(archive, draft)
    discard_blocks(opened.place, recording.take, recording.digest)
    record = read_record(opened.place, recording.take)
    assert record is not None  # it was published just now
    _show(opened.take(recording.take), blocks)
    return {**asdict(record), "published": True}


def _compute_blocks(
    archive: str, recording: Recording, settings: DigitizationSettings
) -> tuple[Blocks, list[str]]:
    """Return the blocks of every stage, and what was noted of the silhouettes."""
    capture = read_capture(Path(recording.path))
    ranges = block_ranges(capture)
    tell = _teller(recording.take, 4 * len(ranges) + 1, capture.frames)
    shared = {"archive": archive, "capture": recording.path, "digest": recording.digest}
    blocks: Blocks = {"silhouettes": [], "carving": [], "coloring": []}

    def into(stage: str, start: int) -> str:
        return block_path(recording.take, recording.digest, stage, start)

    for start, end in ranges:
        found = extract_block_once(
            **shared, into=into("silhouettes", start), start=start, end=end,
            settings=settings.silhouettes,
        )  # fmt: skip
        blocks["silhouettes"].append(found)
        tell("silhouettes", end)
    notes = check_take(archive, recording.path, blocks["silhouettes"])
    for silhouettes in map(_named, blocks["silhouettes"]):
        start, end = silhouettes["start"], silhouettes["end"]
        hulls = carve_block_once(
            **shared, silhouettes=silhouettes, into=into("carving", start),
            settings=settings.carving,
        )  # fmt: skip
        tell("carving", end)
        colors = color_block_once(
            **shared, silhouettes=silhouettes, hulls=_named(hulls), into=into("coloring", start),
            settings=settings.coloring,
        )  # fmt: skip
        tell("coloring", end)
        blocks["carving"].append(hulls)
        blocks["coloring"].append(colors)
    try:
        blocks |= _pose_blocks(shared, recording, blocks, settings.posing, tell, into)
    except InputError as error:
        if capture.initial:  # a person's mistake, to be mended by that person
            raise
        notes.append(f"The take has no pose and is not searched: {error}")
    return blocks, notes


def _pose_blocks(
    shared: dict[str, Any],
    recording: Recording,
    blocks: Blocks,
    settings: PosingSettings,
    tell: Callable[[str, int], None],
    into: Callable[[str, int], str],
) -> Blocks:
    """Return the initial model, the poses and the labels of a take."""
    voxels = {
        "hulls": list(map(_named, blocks["carving"])),
        "colors": list(map(_named, blocks["coloring"])),
    }
    initial = model_take_once(**shared, **voxels, into=into("initial-model", 0))
    named = _named(initial)
    end = voxels["hulls"][-1]["end"]
    fitted = fit_take_once(
        **shared, **voxels, initial=named, into=into("pose", 0), settings=settings
    )
    tell("poses", end)
    labels = []
    for hulls in voxels["hulls"]:
        first, last = hulls["start"], hulls["end"]
        labels.append(
            label_block_once(
                **shared, **voxels, initial=named, fitted=_named(fitted), start=first, end=last,
                into=into("labels", first), settings=settings,
            )
        )  # fmt: skip
        tell("labels", last)
    return {"initial_model": [initial], "pose": [fitted], "labels": labels}


def _show(take: Take, blocks: Blocks) -> None:
    """Put on the dashboard how long each stage took, what was noted, and the initial model."""
    record = take.record
    rows = [
        {
            "stage": stage,
            "blocks": len(parts),
            "seconds": round(sum(part["seconds"] for part in parts), 1),
        }
        for stage, parts in blocks.items()
    ]
    create_table_artifact(
        key="digitized", table=rows, description=f"{record.take}: {record.frames} frames"
    )
    said = "\n".join(f"- {note}" for note in record.notes)
    create_markdown_artifact(
        key="digitized-notes", markdown=f"# {record.take}\n\n{take.path}\n\n{said}"
    )
    if "body" in record.stages:
        picture = b64encode(encode_png(picture_initial(take))).decode()
        create_image_artifact(
            f"data:image/png;base64,{picture}",
            key="digitized-body",
            description=f"{record.take}: the joints that the body was measured by",
        )


def _identity(recording: Recording, settings: DigitizationSettings) -> str:
    """Name what makes a take what it is: the capture, the settings and the code."""
    parts = [
        fingerprint(extract_block, {"settings": settings.silhouettes}),
        fingerprint(carve_block, {"settings": settings.carving}),
        fingerprint(color_block, {"settings": settings.coloring}),
        fingerprint(label_block, {"settings": settings.posing}),  # stands on `fit_take`
        fingerprint(assemble_take, {}),
        recording.digest,
    ]
    return hashlib.sha256("".join(parts).encode()).hexdigest()


def _named(block: dict[str, Any]) -> dict[str, Any]:
    """Return what names a block, without how long it took."""
    names = ("path", "start", "end", "sha256", "frame")
    return {key: block[key] for key in names if key in block}


def _teller(take: str, total: int, frames: int) -> Callable[[str, int], None]:
    """Return what tells that a stage has done a block: a line, and the dashboard's progress."""
    progress = create_progress_artifact(
        progress=0.0, key="digitize-progress", description=f"{take}, {frames} frames"
    )
    done = 0

    def tell(stage: str, end: int) -> None:
        nonlocal done
        done += 1
        logger.info("    %s: %s %d/%d frames", take, stage, end, frames)
        update_progress_artifact(progress, progress=100.0 * done / total)  # type: ignore[arg-type]

    return tell
