"""Whether the silhouettes that were found of a take can be of one performer in the volume."""

from collections.abc import Sequence

from storage import open_archive
from storage.blocks import Block
from storage.errors import InputError
from storage.formats.capture.capture import capture_of
from tasks.capture.films import grid_of, projection_of
from tasks.checks.agreement import AgreementSettings, check_agreement
from tasks.checks.compared import read_silhouettes
from tasks.checks.offsets import Passage, judge_beginnings, timing_of
from tasks.checks.telling import By, all_faults, filled_notes, judge_telling


def check_take(
    archive: str, capture: str, digest: str, blocks: Sequence[Block], settings: AgreementSettings,
    by: By,
) -> list[str]:  # fmt: skip
    """Compare the silhouettes of a few frames of a take with each other; return what to note.

    Parameters
    ----------
    archive, capture, digest
        Where the blocks are, the folder with the calibration and the volume, and the digest of
        what is in it.
    blocks
        What `extract_block` wrote, in the order of the frames.
    settings
        What is still agreement.
    by
        What told the performer from the stage.

    Raises
    ------
    InputError
        If the silhouettes cannot be of one performer in the volume: all that is wrong.
    """
    source = capture_of(capture, digest)
    projection, timing = projection_of(source.cameras), timing_of(source, settings.late_frames)
    silhouettes, telling, touches, (filled, pixels) = read_silhouettes(
        open_archive(archive), source, blocks, by, timing.step
    )
    wrong, known = judge_telling(telling, source, silhouettes)
    begun = judge_beginnings([Passage(0, touches)], projection, timing)
    found = check_agreement(
        silhouettes, projection, grid_of(source), list(timing.names), settings, by
    )
    names = list(timing.names)
    notes = [
        *begun.notes,
        *known,
        *found.notes,
        *filled_notes(filled[None], pixels[None], names, kept=False),
    ]
    if faults := all_faults(telling, wrong, (*begun.faults, *found.faults)):
        said = "\n".join(f"- {each}" for each in (*faults, *notes))
        raise InputError(f"{capture} cannot be digitized:\n{said}")
    return notes
