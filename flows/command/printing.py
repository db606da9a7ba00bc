"""What the command line prints: tables for people, JSON for programs."""

import json
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

from storage.archive import Take
from storage.index.entries import Entry
from storage.records import Record
from storage.schema import JOINTS
from tasks.motion.stature import DEFAULT_STATURE_M
from tasks.takes.identity import is_of_other_code, made_by

if TYPE_CHECKING:
    from flows.outcomes import Outcome
    from tasks.retrieval.answering import Answer, Tell
    from tasks.retrieval.searching import Match


def say(text: str) -> None:
    """Print a message, to standard error."""
    print(text, file=sys.stderr, flush=True)


def print_line(text: str) -> None:
    """Print a line of data."""
    print(text, flush=True)


def print_json(value: Any) -> None:
    """Print one JSON object, its letters as numbers where the output has no such letters."""
    text = json.dumps(value, indent=1, ensure_ascii=False)
    try:
        text.encode(sys.stdout.encoding or "utf-8")
    except UnicodeEncodeError:
        text = json.dumps(value, indent=1)
    print(text, flush=True)


def print_table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print rows under their heads; heads that begin with ">" stand to the right."""
    right = [head.startswith(">") for head in heads]
    names = [head.lstrip(">") for head in heads]
    columns = []
    for column, to_right in zip(zip(names, *rows, strict=True), right, strict=True):
        width = max(map(len, column))
        pad = str.rjust if to_right else str.ljust
        columns.append([pad(text, width) for text in column])
    print("\n".join("  ".join(cells).rstrip() for cells in zip(*columns, strict=True)))


def print_takes(records: Sequence[Entry], *, as_json: bool) -> None:
    """Print the takes of an archive (docs/contract.md, section 7)."""
    if as_json:
        print_json({"takes": [_described(record) for record in records]})
        return
    heads = ("take", "source", ">frames", ">Hz", ">seconds", "performer", "title", "made by")
    rows = [
        (
            *(record.take, record.source["kind"], f"{record.frames:,}", f"{record.rate_hz:g}"),
            f"{record.frames / record.rate_hz:.1f}",
            *(str(record.metadata.get(key, "")) for key in ("performer", "title")),
            made_by(record),
        )
        for record in records
    ]
    print_table(heads, rows)
    if other := sum(is_of_other_code(record) for record in records):
        say(
            f"{other} of {len(records)} takes were made by other code than this shosa's; "
            "`shosa ingest --again` makes them anew"
        )


def print_take(take: Take, *, as_json: bool) -> None:
    """Print all that is known of one take."""
    record = take.record
    size = sum(each["bytes"] for each in record.files.values())
    stature_m, source = _stature(take)
    missing = [joint for joint in JOINTS if joint not in record.joints_present]
    about = {
        **_described(record),
        "metadata": record.metadata,
        "from": record.source["path"],
        "digest": record.source["digest"],
        "joints": record.joints_present,
        "joints_missing": missing,
        "stature_m": stature_m,
        "stature_source": source,
        "version": record.number,
        "of_other_code": is_of_other_code(record),
        "published": record.published,
        "bytes": size,
        "path": take.path,
        "settings": record.settings,
        "notes": record.notes,
    }
    if as_json:
        print_json(about)
        return
    lines = {
        "take": record.take,
        **{str(key): str(value) for key, value in record.metadata.items()},
        "source": f"{record.source['kind']}, {record.source['path']}",
        "length": f"{record.frames:,} frames at {record.rate_hz:g} Hz, "
        f"{record.frames / record.rate_hz:.1f} s",
        **_motion_lines(record, missing, stature_m, source),
        "stages": ", ".join(record.stages),
        "version": f"{record.number}, published {record.published}"
        + ", made by other code than this shosa's" * is_of_other_code(record),
        "on disk": f"{size / 1e6:.2f} MB in {take.path}",
    }
    width = max(map(len, lines))
    for name, text in lines.items():
        print(f"{name.ljust(width)}  {text}")
    for name, value in record.settings.items():
        print(f"{'set'.ljust(width)}  {name} = {json.dumps(value)}, not the default")
    for note in record.notes:
        print(f"{'note'.ljust(width)}  {note}")


def _stature(take: Take) -> tuple[float | None, str | None]:
    """Return a take's stature in metres, and where it is from."""
    if "motion" not in take.record.stages:
        return None, None
    return take.motion.attrs["stature_m"], take.motion.attrs["stature_source"]


def _motion_lines(
    record: Record, missing: Sequence[str], stature_m: float | None, source: str | None
) -> dict[str, str]:
    """Return what is said of the joints of a take, and of its stature."""
    if "motion" not in record.stages:
        return {"joints": "none: its pose was not fitted, so it is not searched"}
    return {
        "joints": f"{len(record.joints_present)} of {len(JOINTS)}"
        + (f" (without {', '.join(missing)})" if missing else ""),
        "stature": f"{stature_m:.3f} m, {source}"
        if stature_m
        else f"unknown: compared as {DEFAULT_STATURE_M:g} m",
    }


def print_outcomes(outcomes: Sequence["Outcome"], *, as_json: bool) -> None:
    """Print what became of each file of an ingest."""
    if as_json:
        print_json({"files": [asdict(outcome) for outcome in outcomes]})
        return
    heads = ("status", "take", ">frames", ">Hz", ">joints", "file")
    rows = [
        (
            *(each.status, each.take or "", f"{each.frames:,}"),
            *(f"{each.rate_hz:g}", str(each.joints), each.path),
        )
        for each in outcomes
    ]
    print_table(heads, rows)


@contextmanager
def told_if_stopped(tell: "Tell | None") -> "Iterator[Tell]":
    """Yield what a search tells, and say what was found until then if it is interrupted."""
    last: tuple[list[Match], int] = ([], 0)

    def keep(matches: "list[Match]", certain: int) -> None:
        nonlocal last
        last = matches, certain
        if tell is not None:
            tell(matches, certain)

    try:
        yield keep
    except KeyboardInterrupt:
        matches, certain = last
        if matches:
            say(f"stopped early; of the {len(matches)} matches until then {certain} are certain:")
        for match in matches:
            say(f"  {match.take}:{match.start}-{match.end}  {match.distance:.4f}")
        raise


def print_answer(answer: "Answer", *, as_json: bool) -> None:
    """Print the matches of a search (docs/contract.md, section 6)."""
    if as_json:
        print_json(answer.as_json())
        return
    print_matches(answer)
    for take, reason in answer.skipped.items():
        say(f"not compared: {take}: {reason}")
    for line in _what_it_means(answer):
        say(line)
    say(
        f"{len(answer.matches)} matches in {len({m.take for m in answer.matches})} takes; searched "
        f"{answer.searched_takes} takes, {answer.searched_frames:,} frames, "
        f"in {answer.seconds:.2f} s"
    )


def print_matches(answer: "Answer", *, most: int | None = None) -> None:
    """Print the matches of a search as a table, the first `most` of them."""
    heads = (">rank", ">distance", "level", "by chance", "take", ">frames", ">seconds", "performer")
    heads = (*heads, "title")
    rows = []
    for rank, match in enumerate(answer.matches[:most], start=1):
        record = answer.records[match.take]
        start_s, end_s = match.start / record.rate_hz, match.end / record.rate_hz
        rows.append(
            (
                str(rank),
                f"{match.distance:.4f}",
                answer.meaning(match)["level"] or "-",
                answer.chance.in_words(match.distance),
                match.take + (" (mirrored)" if match.mirrored else ""),
                f"{match.start}-{match.end}",
                f"{start_s:.2f}-{end_s:.2f}",
                *(str(record.metadata.get(key, "")) for key in ("performer", "title")),
            )
        )
    if rows:
        print_table(heads, rows)


def _what_it_means(answer: "Answer") -> Iterator[str]:
    """Yield what the columns `level` and `by chance` of a table of matches mean."""
    if not answer.matches:
        return
    from tasks.retrieval.meaning.levels import level_thresholds

    meanings = {
        "same": "as near as the same dancer's same movement",
        "like": "as near as another dancer's",
    }
    if levels := level_thresholds(answer.settings):
        named = (f"{name}: {meanings[name]} (below {d:g})" for name, d in levels.items())
        say_levels = "; ".join(named)
        yield f"{say_levels}; -: nothing like it"
    if answer.chance.can_be_told:
        yield (
            f"by chance: of the {answer.chance.clips:,} clips of these takes, how many are so near "
            "that move otherwise"
        )
    else:
        yield "by chance: cannot be told, for these takes have too few clips as long as the query"


def _described(record: Record | Entry) -> dict[str, Any]:
    """Return a take as `takes --json` lists it."""
    return {
        "take": record.take,
        "source": record.source["kind"],
        "title": record.metadata.get("title"),
        "performer": record.metadata.get("performer"),
        "frames": record.frames,
        "rate_hz": record.rate_hz,
        "stages": record.stages,
    }
