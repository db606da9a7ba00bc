"""Look at a match from Python: its clip, and how the query was warped onto it.

Beside `tasks.retrieval.answering.find_matches`, whose table they take.
"""

import os
from collections.abc import Hashable, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from storage import Archive, open_archive
from storage.errors import ArchiveError
from tasks.retrieval.answering import find_query
from tasks.retrieval.meaning.explaining import Explanation, explain_match, samples_of_match
from tasks.retrieval.normalization import INDEX_RATE_HZ, OTHER_SIDE, frame_of_sample
from tasks.retrieval.opening import read_packed_takes
from tasks.retrieval.searching import Match, Query, SearchSettings
from tasks.retrieval.segments import PackedTake

if TYPE_CHECKING:
    import pandas
    import xarray


def read_clip(
    archive: Archive | str | os.PathLike[str],
    match: "Mapping[str, Any] | pandas.Series | Match",
) -> "xarray.DataArray":
    """Return the positions of the joints in the frames of a match.

    Parameters
    ----------
    archive
        An open archive, or where it is: a directory or a URL.
    match
        A row of the table of `find_matches`, such as `table.loc[0]`, or anything else that has
        `take`, `start` and `end`.

    Returns
    -------
    xarray.DataArray
        `position (time, joint, space)`, metres, read on use. The coordinate `time` is in seconds of
        the take, `frame` counts its frames, and `attrs` has `take`, `start`, `end`, `mirrored`. A
        mirrored match is as it was danced: the query's mirror image was found.

    Raises
    ------
    UnknownNameError
        If the take is not there any more.
    ValueError
        If the take has no such frames, or the match lacks one of the three.
    InputError, ArchiveError
        If there is no archive, or the take is damaged.
    """
    found = _match(match)
    position = _opened(archive).take(found.take).motion["position"]
    frames = position.sizes["time"]
    if not 0 <= found.start <= found.end < frames:
        raise ValueError(
            f"take {found.take!r} has the frames 0-{frames - 1}, and not {found.start}-{found.end}"
        )
    clip = position.isel(time=slice(found.start, found.end + 1))
    clip = clip.assign_coords(frame=("time", np.arange(found.start, found.end + 1)))
    about = {name: getattr(found, name) for name in ("take", "start", "end", "mirrored")}
    return clip.assign_attrs(about)


def read_path(
    archive: Archive | str | os.PathLike[str], matches: "pandas.DataFrame", row: Hashable = 0
) -> "pandas.DataFrame":
    """Return how the query was warped onto a match: pairs of frames, and how far apart they are.

    Parameters
    ----------
    archive
        The archive that was searched.
    matches
        The table of `find_matches`, or some of its rows.
    row
        Which match, a label of the table's index: 0 is the nearest of all.

    Returns
    -------
    pandas.DataFrame
        A row a step of the path: `query` and `match` (frames of their takes, neither falling) and
        `distance` (of the two poses, statures). A step is a thirtieth of a second of one of them,
        or of both. Of a take that has fewer frames than that, a frame stands in several rows.

    Raises
    ------
    KeyError
        If the table has no such row.
    ValueError
        If the table does not say what was asked, or was found with the steps `paper`.
    UnknownNameError, InputError, ArchiveError
        As `find_matches`.
    """
    import pandas  # as in `find_matches`

    match = _match(matches.loc[row])
    text, asked = (matches.attrs.get(name) for name in ("query", "settings"))
    if not isinstance(asked, dict) or not isinstance(text, str):
        raise ValueError(
            "the table does not say what was searched for; give the one that find_matches returned"
        )
    settings = SearchSettings(**{**asked, "weights": tuple(asked["weights"].items())})
    if settings.steps != "slope":
        raise ValueError(
            f"the path is known of the steps 'slope' and not of {settings.steps!r}; search so"
        )
    opened = _opened(archive)
    take = opened.take(match.take)  # first: it names what is like the name of a take that is gone
    query, clip = find_query(opened, opened.listing(), text, None)
    packed, faults = read_packed_takes(opened.place, [take.record])
    if faults:
        raise ArchiveError(faults[match.take])
    explained, first = explain_found(query, packed[0], match, settings)
    begin = round(clip["start"] * INDEX_RATE_HZ / query.rate_hz)
    frames = {
        "query": _frames(begin + explained.pairs[:, 0], query.rate_hz, clip["end"]),
        "match": _frames(first + explained.pairs[:, 1], take.record.rate_hz, match.end),
    }
    return pandas.DataFrame({**frames, "distance": explained.distance})


def explain_found(
    query: Query, take: PackedTake, match: Match, settings: SearchSettings
) -> tuple[Explanation, int]:
    """Return how a query was warped onto a match in a take, and the sample at which it starts.

    Raises
    ------
    ValueError
        As `explain_match`.
    """
    own = query.joints_present[OTHER_SIDE] if match.mirrored else query.joints_present
    joints = own & take.joints_present
    starts, ends = samples_of_match(match.start, match.end, take.rate_hz, take.frames)
    found: list[tuple[float, Explanation, int]] = []
    faults = []
    for first in starts:
        for last in ends:
            rows = np.asarray(take.rows[:, first : last + 1])
            try:
                each = explain_match(query.rows, rows, joints, settings, mirrored=match.mirrored)
            except ValueError as error:
                faults.append(error)
                continue
            found.append((abs(each.total - match.distance), each, first))
    if not found:
        raise faults[0]
    _, explained, first = min(found, key=lambda each: each[0])
    return explained, first


def _frames(samples: NDArray[np.int64], rate_hz: float, last: int) -> NDArray[np.int64]:
    """Return the frames nearest to samples, up to the last one of the clip."""
    return np.array([min(frame_of_sample(int(each), rate_hz), last) for each in samples])


def _opened(archive: Archive | str | os.PathLike[str]) -> Archive:
    return archive if isinstance(archive, Archive) else open_archive(archive)


def _match(match: "Mapping[str, Any] | pandas.Series | Match") -> Match:
    """Return a match whatever it comes as."""
    if isinstance(match, Match):
        return match
    said: Any = match
    try:
        return Match(
            str(said["take"]),
            int(said["start"]),
            int(said["end"]),
            float(said.get("distance", 0.0)),
            bool(said.get("mirrored", False)),
        )
    except KeyError as error:
        raise ValueError(f"a match has take, start and end, and this has no {error}") from None
