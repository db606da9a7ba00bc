"""One HTML file with a query and its matches, for whoever has neither the archive nor a network.

It plays the overlays by itself: the poses of the clips are inside, packed as for the pages, and the
same small modules draw them. Nothing is fetched when it is opened.
"""

import base64
import html
import json
import re
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from storage.files import write_beside
from storage.places import told
from storage.provenance import now, shosa_version
from storage.schema import JOINTS
from tasks.retrieval.answering import Answer
from tasks.retrieval.normalization import INDEX_RATE_HZ
from viewer.holdings import Holdings, Motion
from viewer.pairing import BODY, listed, pair
from viewer.texts import texts_of
from viewer.tracks import pack_track

_STATIC = Path(__file__).parent / "static"
_MODULES = ("shosa/figures.js", "shosa/player.js", "shosa/sticks.js", "report.js")
_CONTEXT_S = 2.0
"""How much of a take is told before and after its clip [s]. Enough for a curve to be read."""
_MOST_ROWS = 900
"""How many poses of a clip are written at most: half a minute at 30 Hz. Longer ones are thinned."""
_POLICY = "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"


def write_report(
    holdings: Holdings,
    answer: Answer,
    motion: Motion,
    file: str | Path,
    *,
    language: str = "en",
) -> str:
    """Write the report of a search; return what was written.

    Parameters
    ----------
    motion
        What the query is a clip of.

    Raises
    ------
    ArchiveError
        If a take that was found cannot be read any more.
    PlaceError
        If the file cannot be written.
    """
    content = make_report(holdings, answer, motion, language).encode()
    with told(f"write {file}"):
        write_beside(Path(file), content)
    return f"{file}: {len(answer.matches)} matches, {len(content) / 1e6:.1f} MB"


def make_report(holdings: Holdings, answer: Answer, motion: Motion, language: str) -> str:
    """Return the report of a search as a page; raises an ArchiveError as `write_report`."""
    texts = texts_of(language)
    clip = (answer.query["start"], answer.query["end"])
    scores = [pair(holdings, motion, clip, match, answer.settings) for match in answer.matches]
    content = {
        "body": BODY,
        "texts": dict(texts),
        "rows": listed(holdings, answer, texts),
        "scores": scores,
        "query": _packed(motion, *clip),
        "matches": [
            _packed(holdings.motion(match.take), match.start, match.end) for match in answer.matches
        ],
        "joint": _telling_joint(answer),
    }
    title = f"{motion.title} {clip[0]}-{clip[1]}"
    about = _provenance(holdings, answer, texts)
    rows = "".join(
        f"<tr><th>{html.escape(name)}</th><td>{html.escape(value)}</td></tr>"
        for name, value in about.items()
    )
    values = {
        "LANGUAGE": language,
        "POLICY": _POLICY,
        "TITLE": html.escape(f"{title} · {texts['site']}"),
        "STYLE": (_STATIC / "report.css").read_text("utf-8"),
        "HEAD": html.escape(title),
        "PROVENANCE": rows,
        # no </script> can stand in it
        "CONTENT": json.dumps(content, ensure_ascii=False).replace("<", "\\u003c"),
        "SCRIPT": _script(),
    }
    page = (_STATIC / "report.html").read_text("utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda found: values[found[1]], page)


def _packed(motion: Motion, start: int, end: int) -> dict[str, Any]:
    """Return the poses of a clip and of a little around it."""
    around = round(_CONTEXT_S * motion.rate_hz)
    first, last = max(0, start - around), min(motion.frames - 1, end + around)
    step = max(1, int(motion.rate_hz // INDEX_RATE_HZ), -(-(last - first + 1) // _MOST_ROWS))
    position = np.asarray(motion.position[first : last + 1 : step])
    packed = base64.b64encode(pack_track(position, first, step)).decode()
    return {"track": packed, "first": first, "step": step}


def _telling_joint(answer: Answer) -> str:
    """Return the joint whose curves are shown first."""
    from tasks.retrieval.weighting import joint_weights

    weights = joint_weights(answer.settings)
    compared = [joint for joint, weight in zip(JOINTS, weights, strict=True) if weight > 0]
    telling = ("RWrist", "LWrist", "RFoot", "LFoot", "Head")
    return next((joint for joint in telling if joint in compared), compared[0])


def _provenance(holdings: Holdings, answer: Answer, texts: Mapping[str, str]) -> dict[str, str]:
    """Return what was asked, of what, by what and when."""
    settings = {k: v for k, v in asdict(answer.settings).items() if v not in (None, (), False, 0.0)}
    query = answer.query
    takes = {match.take for match in answer.matches} | {query.get("take", "")}
    versions = {
        take: f"{record.number} ({record.source['kind']}, {record.source['digest'][:12]})"
        for take in sorted(takes)
        if (record := answer.records.get(take)) is not None
    }
    searched = f"{answer.searched_takes:,} · {answer.searched_frames:,} {texts['frames']}"
    return {
        texts[
            "query_word"
        ]: f"{query.get('take') or query.get('file')} {query['start']}-{query['end']}",
        texts["settings"]: ", ".join(f"{k} = {v}" for k, v in settings.items()),
        texts["archive"]: holdings.location,
        texts["searched_word"]: searched,
        texts["versions"]: ", ".join(f"{take} {about}" for take, about in versions.items()),
        texts["made_by"]: f"shosa {shosa_version()}, {now()}",
    }


def _script() -> str:
    """Return the modules that draw, as one script."""
    parts = []
    for name in _MODULES:
        text = (_STATIC / name).read_text("utf-8")
        text = re.sub(r"^import .*?;\n", "", text, flags=re.MULTILINE)
        parts.append(re.sub(r"^export ", "", text, flags=re.MULTILINE))
    tracks = (_STATIC / "shosa/tracks.js").read_text("utf-8")
    found = re.search(r"^export (function decodeTrack.*?^}\n)", tracks, re.MULTILINE | re.DOTALL)
    assert found is not None
    return "const LOST = -32768;\n" + found[1] + "\n".join(parts)
