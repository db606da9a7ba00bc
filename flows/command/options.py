"""What the options of the commands mean, and which mean nothing: said before work begins."""

import argparse
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from storage import open_archive
from storage.errors import ArchiveError, InputError, UnknownNameError
from storage.formats import MOTION_SUFFIXES
from storage.kept import kept_limit
from storage.schema import parse_frames

if TYPE_CHECKING:
    from tasks.motion.importing import ImportSettings
    from tasks.retrieval.searching import SearchSettings

_MOST_HOURS = 24.0 * 366 * 100
"""The largest age that `gc` understands [h]. A century, before which there were no such files."""


class UsageError(ValueError):
    """The command was called with values that do not go together."""


@contextmanager
def values_refused() -> Iterator[None]:
    """Turn what is said of a value that means nothing into a UsageError.

    What is the fault of an archive, a file or an unknown name is raised as it is.
    """
    try:
        yield
    except (InputError, ArchiveError, UnknownNameError, UsageError):
        raise
    except ValueError as error:
        raise UsageError(str(error)) from error


def check_environment() -> None:
    """See that what the environment sets for a digitization means something, before it begins.

    Raises
    ------
    UsageError
        If it does not.
    """
    with values_refused():
        kept_limit()


def add_search_options(command: argparse.ArgumentParser) -> None:
    """Add the options that say what a search compares, and in which takes."""
    command.add_argument("--part", default="whole", help="whole, upper, arms, feet, ...")
    command.add_argument(
        "--weight", action="append", default=[], metavar="JOINT=W", help="may be repeated"
    )
    command.add_argument("--top", type=int, default=10, metavar="N", help="at most N matches")
    command.add_argument(
        "--threshold", metavar="D", help="only distances below D, or of the level same or like"
    )
    command.add_argument("--mirror", action="store_true", help="also left and right exchanged")
    command.add_argument(
        "--path-weight", type=float, default=0.0, metavar="W", help="count where the dancer goes"
    )
    command.add_argument(
        "--skip-doubtful", action="store_true", help="no match where the pose is doubtful"
    )
    command.add_argument("--takes", metavar="GLOB", help="search only in these takes")
    add_import_options(command)


def add_import_options(command: argparse.ArgumentParser) -> None:
    """Add the options that say how a motion file is read."""
    command.add_argument("--map", metavar="FILE.toml", help="which markers make which joint")
    command.add_argument("--scale", type=float, metavar="M", help="metres in one unit of the file")
    command.add_argument("--up", choices=("x", "y", "z"), help="the file's axis that points up")


def import_settings(
    options: argparse.Namespace, low_pass_hz: float | None = None
) -> "ImportSettings":
    """Return how motion files are to be read.

    Raises
    ------
    UsageError
        If a number means nothing.
    InputError
        If the map cannot be read.
    """
    from tasks.motion.importing import ImportSettings, read_joint_map

    for name, value in (("--scale", options.scale), ("--low-pass", low_pass_hz)):
        if value is not None and not 0 < value < math.inf:
            raise UsageError(f"{name} {value:g} should be a number above 0")
    mapping = read_joint_map(Path(options.map)) if options.map is not None else None
    return ImportSettings(
        scale=options.scale, up=options.up, mapping=mapping, low_pass_hz=low_pass_hz
    )


def query_settings(options: argparse.Namespace) -> "ImportSettings | None":
    """Return how the file of a query is to be read; raises as `import_settings`."""
    given = [name for name in ("map", "scale", "up") if getattr(options, name) is not None]
    if not given:
        return None
    from tasks.retrieval.answering import parse_query

    name, _ = parse_query(options.query)
    if Path(name).suffix.lower() not in MOTION_SUFFIXES:
        raise UsageError(
            f"--{given[0]} says how a file is read, and the query {name!r} is a take; leave it out"
        )
    return import_settings(options)


def search_settings(options: argparse.Namespace) -> "SearchSettings":
    """Return what a search compares.

    Raises
    ------
    UsageError
        With all that means nothing.
    """
    from tasks.retrieval.answering import parse_query
    from tasks.retrieval.meaning.levels import threshold_of
    from tasks.retrieval.searching import SearchSettings
    from tasks.retrieval.weighting import joint_weights

    given = {each.name for each in fields(SearchSettings)} - {"weights", "threshold"}
    settings = SearchSettings(
        weights=_weights(options.weight), **{name: getattr(options, name) for name in given}
    )
    try:
        joint_weights(settings)
        settings = replace(settings, threshold=threshold_of(options.threshold, settings))
        parse_query(options.query)
    except ValueError as error:
        raise UsageError(str(error)) from error
    return settings


def digitization_settings(file: str | None) -> dict[str, Any]:
    """Return the tables of a file of settings, once they are known to be good."""
    if file is None:
        return {}
    from storage.formats.settings_toml import read_settings_tables
    from tasks.settings import read_settings

    tables = read_settings_tables(Path(file))
    read_settings(tables, file)
    return tables


def clip_of(options: argparse.Namespace) -> tuple[int, int] | None:
    """Return what `--frames` says; UsageError where it says nothing."""
    with values_refused():
        return parse_frames(options.frames) if options.frames is not None else None


def check_hours(hours: float) -> None:
    """Refuse an age that is none, with a UsageError."""
    if not 0 <= hours <= _MOST_HOURS:
        raise UsageError(
            f"--older-than {hours:g} should be hours, 0 or more, and {_MOST_HOURS:,.0f} at most"
        )


def check_before_flow(options: argparse.Namespace) -> None:
    """Refuse a search that a flow would refuse as well, before Prefect starts, which takes long.

    Raises
    ------
    InputError, ArchiveError, UnknownNameError
        If there is no archive, or neither such a take nor such a file.
    """
    from tasks.retrieval.answering import parse_query

    archive = open_archive(options.archive)
    name, _ = parse_query(options.query)
    if Path(name).suffix.lower() not in MOTION_SUFFIXES:
        archive.take(name)
    elif not Path(name).is_file():
        raise InputError(f"{name} is no file; check the path")


def _weights(texts: Sequence[str]) -> tuple[tuple[str, float], ...]:
    """Return JOINT=W as pairs."""
    weights: dict[str, float] = {}
    for text in texts:
        joint, _, number = text.partition("=")
        if joint in weights:
            raise UsageError(f"--weight {text}: {joint} has a weight already; give it once")
        try:
            weights[joint] = float(number)
        except ValueError:
            raise UsageError(f"--weight {text} should be JOINT=W, such as RFoot=2") from None
    return tuple(weights.items())
