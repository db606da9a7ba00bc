"""What a page needs to show a query and one match: clips, the warping path, why they are near."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from storage.index.entries import Entry
from storage.records import Record
from storage.schema import JOINTS
from tasks.rendering.drawing.stick_figures import FIGURE_LINES
from tasks.retrieval.answering import Answer
from tasks.retrieval.clips import explain_found
from tasks.retrieval.meaning.chance import Chance, one_in
from tasks.retrieval.meaning.explaining import Explanation, compared_about_shoulders
from tasks.retrieval.meaning.levels import level_of
from tasks.retrieval.normalization import INDEX_RATE_HZ, OTHER_SIDE
from tasks.retrieval.searching import Match, Query, SearchSettings, clip_motion, clip_take
from tasks.retrieval.segments import PackedTake
from tasks.retrieval.weighting import joint_weights
from viewer.holdings import FILE, Holdings, Motion, performer_of, title_of

BODY = {
    "joints": list(JOINTS),
    "bones": [["Neck", "Head"], *([a, b] for a, b in FIGURE_LINES)],
    "otherSide": OTHER_SIDE.tolist(),
}
"""What the drawing needs to know of a body."""

_POSES = 4
"""How many poses stand beside a match."""
_WIDE, _HIGH = 96.0, 40.0
"""Size of the picture of these poses [units]."""
_ASIDE = 0.5
"""How far aside of straight ahead the poses are seen from [rad]. As the figures of `rendering`."""


def shown_motion(motion: Motion, start: int, end: int) -> dict[str, Any]:
    """Return what a page's components are told of a motion and its clip."""
    return {
        "take": motion.name,
        "version": motion.version,
        "title": motion.title,
        "performer": motion.performer,
        "frames": motion.frames,
        "rate": motion.rate_hz,
        "stature": motion.stature_m,
        "voxels": motion.has_voxels,
        "joints": motion.position is not None,
        "start": start,
        "end": end,
    }


def query_of(holdings: Holdings, motion: Motion, start: int, end: int) -> Query:
    """Return the clip of a motion as a query; raises as `clip_take`, or an ArchiveError."""
    if motion.version == FILE:
        position = np.asarray(motion.position[0 : motion.frames])
        return clip_motion(
            position, motion.rate_hz, motion.stature_m, (start, end), name=motion.title
        )
    packed = _packed(holdings, motion)
    return clip_take(packed, start, end)


def pair(
    holdings: Holdings,
    motion: Motion,
    clip: tuple[int, int],
    match: Match,
    settings: SearchSettings,
) -> dict[str, Any]:
    """Return what the stage and the curves show of a query and one match.

    Raises
    ------
    UnknownNameError, ArchiveError, ValueError
        If the take of the match is not there any more, or is damaged.
    """
    other = holdings.motion(match.take)
    explained, starts = explain(holdings, query_of(holdings, motion, *clip), other, match, settings)
    weights = joint_weights(settings)
    seconds = explained.pairs / INDEX_RATE_HZ
    # from the first frame of the clip as it is shown, which the first sample is near
    shift = starts / INDEX_RATE_HZ - match.start / other.rate_hz
    seconds[:, 1] = np.maximum(seconds[:, 1] + shift, 0.0)
    return {
        "query": shown_motion(motion, *clip),
        "match": {
            **shown_motion(other, match.start, match.end),
            "mirrored": match.mirrored,
            "distance": match.distance,
            "path": seconds.round(4).tolist(),
            "near": explained.distance.round(5).tolist(),
            "byJoint": [None if np.isnan(v) else round(float(v), 5) for v in explained.by_joint],
        },
        "strong": np.flatnonzero(weights > 0).tolist(),
        "about": "shoulders" if compared_about_shoulders(weights) else "hips",
    }


def explain(
    holdings: Holdings, query: Query, other: Motion, match: Match, settings: SearchSettings
) -> tuple[Explanation, int]:
    """Return how a query was warped onto a match, and the sample at which the match starts."""
    return explain_found(query, _packed(holdings, other), match, settings)


def listed(holdings: Holdings, answer: Answer, texts: Mapping[str, str]) -> list[dict[str, Any]]:
    """Return the rows of the list of the matches of an answer, with pictures of some poses."""
    rows = _rows(holdings, answer.matches, answer.records, answer.settings)
    for row, match in zip(rows, answer.matches, strict=True):
        row["chance"] = _chance_in_words(answer.chance, match.distance, texts)
    return rows


def listed_so_far(
    holdings: Holdings, matches: Sequence[Match], certain: int, settings: SearchSettings
) -> list[dict[str, Any]]:
    """Return the rows of a search that goes on; all but the first `certain` may still go.

    How many clips are so near by chance is known at its end only. A match in a take that was
    published since the takes were listed is left out until then.
    """
    records = {record.take: record for record in holdings.records_at_hand()}
    rows = _rows(holdings, [m for m in matches if m.take in records], records, settings)
    for row in rows[certain:]:
        row["open"] = True
    return rows


def _rows(
    holdings: Holdings,
    matches: Sequence[Match],
    records: Mapping[str, Record | Entry],
    settings: SearchSettings,
) -> list[dict[str, Any]]:
    """Return what is listed of each match."""
    farthest = max((match.distance for match in matches), default=0.0) or 1.0
    return [
        {
            "rank": rank,
            "title": title_of(records[match.take]),
            "performer": performer_of(records[match.take]),
            "take": match.take,
            "first": match.start,
            "last": match.end,
            "seconds": f"{(match.end - match.start) / records[match.take].rate_hz:.1f}",
            "distance": f"{match.distance:.3f}",
            "share": round(100 * match.distance / farthest, 1),
            "mirrored": match.mirrored,
            "level": level_of(match.distance, settings),
            "strip": strip_of(holdings.packed(records[match.take]), match.start, match.end),
        }
        for rank, match in enumerate(matches, start=1)
    ]


def _chance_in_words(chance: Chance, distance: float, texts: Mapping[str, str]) -> str:
    """Return how many of the archive's clips are so near by chance; nothing if it is not known."""
    share = chance.of(distance)
    if share is None:
        return ""
    if (clips := one_in(share)) == 1:
        return texts["most"]
    name = "rarer_than_one_in" if share <= chance.least else "one_in"
    return texts[name].format(count=f"{clips:,}")


def strip_path(poses: NDArray[np.floating]) -> str:
    """Return stick figures in a row as the path of an SVG, 96 by 40 units.

    Parameters
    ----------
    poses : (pose, 21, 3) float
        Seen from +Z, y up, in any unit; NaN where a joint is missing.
    """
    lines = []
    heights = poses[..., 1][np.isfinite(poses[..., 1])]
    if not len(heights):
        return ""
    low, high = float(heights.min()), float(heights.max())
    scale = 0.92 * _HIGH / max(high - low, 0.3)
    cell = _WIDE / len(poses)
    for number, pose in enumerate(poses):
        at = dict(zip(JOINTS, pose, strict=True))
        across = pose[np.isfinite(pose[:, 0]), 0]
        middle = (across.min() + across.max()) / 2 if len(across) else 0.0
        for a, b in (("Head", "Neck"), *FIGURE_LINES):
            ends = [
                (cell * (number + 0.5) + scale * (at[n][0] - middle), 38 - scale * (at[n][1] - low))
                for n in (a, b)
            ]
            if np.isfinite(ends).all():
                (x0, y0), (x1, y1) = ends
                lines.append(f"M{x0:.1f} {y0:.1f}L{x1:.1f} {y1:.1f}")
    return "".join(lines)


def strip_of(take: PackedTake, start: int, end: int) -> str:
    """Return the picture of some poses of a clip, as `strip_path`."""
    frames = np.linspace(start, end, _POSES)
    last = take.rows.shape[1] - 1
    samples = np.clip(np.rint(frames * INDEX_RATE_HZ / take.rate_hz), 0, last).astype(int)
    rows = np.asarray(take.rows[:63, samples], np.float64)
    x, y, z = np.moveaxis(rows.reshape(len(JOINTS), 3, -1), 1, 0)
    right = z * np.cos(_ASIDE) - x * np.sin(_ASIDE)  # packed poses face -X, their left is +Z
    return strip_path(np.stack([right.T, y.T, x.T], axis=2))


def _packed(holdings: Holdings, motion: Motion) -> PackedTake:
    """Return the packed array of a take; raises an ArchiveError where it cannot be read."""
    return holdings.packed(holdings.take(motion.name, motion.version).record)
