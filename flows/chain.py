"""The order of the stages from films to joints, whoever runs them: a flow, a benchmark or a test.

Films -> silhouettes -> visual hulls -> colored voxels -> things that stand still -> initial model
-> poses -> final labels -> provisional labels -> joint tracks. (The paper's provisional labels come
before the pose: its method makes them inside the fit; what the stage stores are the same.)
"""

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import copy_context
from functools import partial
from typing import Any

from storage.blocks import Block, Written, block_path
from storage.errors import InputError
from storage.formats.capture.capture import capture_of
from storage.recordings import Recording
from tasks.body.final_labeling import label_block
from tasks.body.initial_model import model_take
from tasks.body.joint_tracks import track_take
from tasks.body.pose_fitting import fit_take
from tasks.body.provisional_labeling import label_block_provisionally
from tasks.capture.films import block_ranges
from tasks.checks.take_silhouettes import check_take
from tasks.checks.telling import told_by
from tasks.engine.progress import listening
from tasks.reconstruction.carving import carve_block
from tasks.reconstruction.coloring import color_block
from tasks.reconstruction.silhouettes import extract_block
from tasks.reconstruction.still_things import find_still_take
from tasks.settings import Settings
from tasks.takes.beginning import Blocks

Run = Callable[..., Written]
"""Calls a stage's store function, the first argument, with the keywords that follow."""

RunBlocks = Callable[[Callable[..., Written], Sequence[dict[str, Any]]], Iterator[Written]]
"""Calls a stage's store function with each of some sets of keywords, and gives back what it returns
in their order."""

Tell = Callable[[str, float], None]
"""Is told a stage and the frame that it has come to: at its beginning, in it, and at its end.

A stage that goes through the take several times tells which share of its work is done, in frames.
"""

_AT_ONCE = 2
"""How many blocks of a stage are worked on at a time [blocks]. One processor packs and writes a
block; the next block is computed meanwhile. The first one is alone: it also reads what all need.
Two blocks of silhouettes, or of provisional labels, hold up to 100 MB more and gain least."""


def digitize(
    archive: str, recording: Recording, settings: Settings, *, run: Run, tell: Tell,
    run_blocks: RunBlocks | None = None, begin: Callable[[Blocks], Any] | None = None,
) -> tuple[Blocks, list[str]]:  # fmt: skip
    """Run every stage on a capture; return what they wrote, and what was noted.

    A take without an initial model keeps its colored voxels, and a note says why.

    Parameters
    ----------
    archive
        Where the blocks go.
    recording
        The capture, with its digest and the name of its take.
    settings
        Of every stage; each is given those that it reads.
    run, tell
        How a stage is run, and what hears of progress.
    run_blocks
        How a stage before the poses is run on many blocks at once; by default `run` runs one after
        another.
    begin
        Is told when the voxels are colored, and returns at once: what needs no pose can be written
        beside the stages that follow, which keep one processor busy half of their time.

    Raises
    ------
    InputError
        If the capture cannot be digitized, or its `initial.json` cannot be used.
    """
    blocks, notes = make_voxels(
        archive, recording, settings, run=run, tell=tell, run_blocks=run_blocks
    )
    if begin:
        begin(blocks)
    try:
        blocks |= make_poses(archive, recording, blocks, settings, run=run, tell=tell)
    except InputError as error:
        if capture_of(recording.path, recording.digest).initial:
            raise  # a person's mistake, to be mended by that person
        notes.append(f"The take has no pose and is not searched: {error}")
    return blocks, notes


def make_voxels(
    archive: str, recording: Recording, settings: Settings, *, run: Run, tell: Tell,
    run_blocks: RunBlocks | None = None,
) -> tuple[Blocks, list[str]]:  # fmt: skip
    """Run the stages from the films to colored voxels; as `digitize`."""
    shared = {"archive": archive, "capture": recording.path, "digest": recording.digest}
    source = capture_of(recording.path, recording.digest)
    ranges = block_ranges(source)

    def run_all(
        function: Callable[..., Written], stage: str, own: Sequence[dict[str, Any]],
        in_turn: RunBlocks,
    ) -> list[Written]:  # fmt: skip
        calls = [
            {**shared, "into": _into(recording, stage, start), **each}
            for (start, _), each in zip(ranges, own, strict=True)
        ]
        runs = (run_blocks or in_turn)(function, calls)
        return _run_told(runs, stage, ranges, tell)

    films = run_all(
        extract_block, "silhouettes",
        [{"start": a, "end": b, "settings": settings.silhouettes} for a, b in ranges],
        partial(_run_in_turn, run),
    )  # fmt: skip
    by = told_by(source, settings.silhouettes.background, settings.silhouettes.key)
    notes = check_take(**shared, blocks=_blocks(films), settings=settings.agreement, by=by)
    hulls = run_all(
        carve_block, "carving",
        [{"silhouettes": film, "settings": settings.carving} for film in _blocks(films)],
        partial(_run_ahead, run),
    )  # fmt: skip
    colors = run_all(
        color_block, "coloring",
        [
            {"silhouettes": film, "hulls": hull, "settings": settings.coloring}
            for film, hull in zip(_blocks(films), _blocks(hulls), strict=True)
        ],
        partial(_run_ahead, run),
    )  # fmt: skip
    return {"silhouettes": films, "carving": hulls, "coloring": colors}, notes


def make_poses(
    archive: str, recording: Recording, voxels: Blocks, settings: Settings, *, run: Run, tell: Tell
) -> Blocks:
    """Run the stages from colored voxels to joints; as `digitize`."""
    shared = {"archive": archive, "capture": recording.path, "digest": recording.digest}
    hulls, colors = _blocks(voxels["carving"]), _blocks(voxels["coloring"])
    shared |= {"hulls": hulls}
    frames = hulls[-1].end
    with _told(tell, "still_things", 0, frames):
        still = run(find_still_take, **shared, into=_into(recording, "still_things", 0))
    with _told(tell, "initial_model", 0, frames):
        model = run(
            model_take, **shared, colors=colors, into=_into(recording, "initial_model", 0),
            settings=settings.initial_model, still=still.block,
        )  # fmt: skip
    by_paper = settings.pose_fitting.method == "paper"
    with _told(tell, "pose_fitting", 0, frames):
        fit = run(
            fit_take, **shared, colors=colors, initial=model.block,
            into=_into(recording, "pose_fitting", 0),
            settings=settings.pose_fitting.read_by_method(),
            provisional=settings.for_labels() if by_paper else None, still=still.block,
        )  # fmt: skip
    shared |= {"initial": model.block, "fitted": fit.block}
    ranges = [(hull.start, hull.end) for hull in hulls]

    def label_all(
        function: Callable[..., Written], stage: str, own: Sequence[dict[str, Any]],
        in_turn: RunBlocks,
    ) -> list[Written]:  # fmt: skip
        calls = [
            {
                **shared, "still": still.block, "into": _into(recording, stage, start),
                "start": start, "end": end, **each,
            }
            for (start, end), each in zip(ranges, own, strict=True)
        ]  # fmt: skip
        return _run_told(in_turn(function, calls), stage, ranges, tell)

    final = label_all(label_block, "final_labeling", [{} for _ in ranges], partial(_run_ahead, run))
    provisional = []
    if settings.provisional_labeling.keep:
        own = {"colors": colors, "settings": settings.for_labels()}
        provisional = label_all(
            label_block_provisionally, "provisional_labeling",
            [{**own, "labels": _blocks(final[: n + 1])} for n in range(len(ranges))],
            partial(_run_in_turn, run),
        )  # fmt: skip
    with _told(tell, "joint_tracks", 0, frames):
        tracked = run(
            track_take, **shared, labels=_blocks(final), into=_into(recording, "joint_tracks", 0),
            settings=settings.joint_tracks,
        )  # fmt: skip
    return {
        "still_things": [still],
        "initial_model": [model],
        "pose_fitting": [fit],
        "final_labeling": final,
        **({"provisional_labeling": provisional} if provisional else {}),
        "joint_tracks": [tracked],
    }


def _run_told(
    runs: Iterator[Written], stage: str, ranges: Sequence[tuple[int, int]], tell: Tell
) -> list[Written]:
    """Return what a stage gives back of each block, and tell how far it is."""
    written = []
    for start, end in ranges:
        with _told(tell, stage, start, end):
            written.append(next(runs))
    return written


def _run_in_turn(
    run: Run, function: Callable[..., Written], calls: Sequence[dict[str, Any]]
) -> Iterator[Written]:
    """Yield what a stage's store function returns for each set of keywords, one after another."""
    return (run(function, **call) for call in calls)


def _run_ahead(
    run: Run, function: Callable[..., Written], calls: Sequence[dict[str, Any]]
) -> Iterator[Written]:
    """Yield what a stage's store function returns for each set of keywords, in their order.

    Who listens hears of the first block as it is worked on, and of the others when they are done.
    """
    first, *others = calls
    yield run(function, **first)
    running: deque[Future[Written]] = deque()
    with ThreadPoolExecutor(_AT_ONCE) as pool:
        for call in others:
            running.append(pool.submit(copy_context().run, _unheard, run, function, call))
            if len(running) == _AT_ONCE:
                yield running.popleft().result()
        while running:
            yield running.popleft().result()


def _unheard(run: Run, function: Callable[..., Written], call: dict[str, Any]) -> Written:
    """Run a stage's store function; who listens to another block hears nothing of it."""
    with listening(lambda _share: None):
        return run(function, **call)


@contextmanager
def _told(tell: Tell, stage: str, start: int, end: int) -> Iterator[None]:
    """Tell how far a stage is that goes from one frame to before another."""
    tell(stage, start)
    with listening(lambda share: tell(stage, start + (end - start) * share)):
        yield
    tell(stage, end)


def _into(recording: Recording, stage: str, start: int) -> str:
    """Return where the block of a stage that begins at a frame goes."""
    return block_path(recording.take, recording.digest, stage, start)


def _blocks(written: Sequence[Written]) -> list[Block]:
    """Return the blocks that a stage wrote."""
    return [each.block for each in written]
