"""What a digitization shows on the dashboard: progress, times, notes, the measured body."""

import logging
from base64 import b64encode
from collections.abc import Callable

from prefect.artifacts import (
    create_image_artifact,
    create_markdown_artifact,
    create_progress_artifact,
    create_table_artifact,
    update_progress_artifact,
)

from storage.archive import Take
from tasks.exporting.voxels import initial_model_png
from tasks.takes.assembling import Blocks

logger = logging.getLogger(__name__)

_BLOCK_STAGES, _TAKE_STAGES = 5, 3
"""Stages that tell of each block of frames, and those that tell once a take."""


def progress_teller(take: str, blocks: int, frames: int) -> Callable[[str, int], None]:
    """Return what tells how far a take is: a line a block, and the dashboard's progress.

    Parameters
    ----------
    take
        How it is called.
    blocks, frames
        Of the take.
    """
    progress = create_progress_artifact(
        progress=0.0, key="digitize-progress", description=f"{take}, {frames} frames"
    )
    total = _BLOCK_STAGES * blocks + _TAKE_STAGES
    done = 0

    def tell(stage: str, end: int) -> None:
        nonlocal done
        done += 1
        logger.info("    %s: %s %d/%d frames", take, stage.replace("_", " "), end, frames)
        update_progress_artifact(progress, progress=100.0 * done / total)  # type: ignore[arg-type]

    return tell


def show_digitized(take: Take, blocks: Blocks) -> None:
    """Show how long each stage took, what was noted, and the initial model."""
    record = take.record
    rows = [
        {
            "stage": stage.replace("_", " "),
            "blocks": len(parts),
            "seconds": round(sum(part.seconds for part in parts), 1),
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
        picture = b64encode(initial_model_png(take)).decode()
        create_image_artifact(
            f"data:image/png;base64,{picture}",
            key="digitized-body",
            description=f"{record.take}: the joints that the body was measured by",
        )
