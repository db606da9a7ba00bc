"""Choose the markers or bones of a file that give the points of the body."""

import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.motion.marker_sets import MARKER_SETS, MarkerSet, bare_name, without_shared_prefixes
from tasks.motion.virtual_joints import place_points, plan_points

Recipe = tuple[int, ...]
"""The markers, by index, whose middle is the point."""


@dataclass(frozen=True)
class Choice:
    """The markers of a file that were chosen for the points of the body."""

    marker_set: str
    recipes: Mapping[str, Recipe]
    """For each point that the file gives, the markers whose middle it is."""
    notes: tuple[str, ...] = ()
    faults: tuple[str, ...] = ()
    """What is wrong with the mapping, a clause each."""

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that the file gives, or that follow from what it gives."""
        have = set(self.recipes) | {rule.point for rule in plan_points(self.recipes)}
        return tuple(joint for joint in JOINTS if joint in have)

    def alone(self) -> tuple["Choice", list[int]]:
        """Return the choice among the chosen markers alone, and which those are."""
        markers = sorted({marker for recipe in self.recipes.values() for marker in recipe})
        place = {marker: at for at, marker in enumerate(markers)}
        recipes = {
            point: tuple(place[marker] for marker in recipe)
            for point, recipe in self.recipes.items()
        }
        return replace(self, recipes=recipes), markers


def choose_points(
    names: Sequence[str],
    present: NDArray[np.bool_],
    mapping: Sequence[tuple[str, Sequence[str]]] = (),
) -> Choice:
    """Return the markers that give the most joints, by the set that fits the file best.

    Of several sets that give as many joints, the one is taken that knows more of the file's
    names, then the first in `MARKER_SETS`; of several performers in one file the one with the
    most joints, then the first. Of the ways to have a point the first is taken whose markers
    are together present in half of the frames, else the one present most often.

    Parameters
    ----------
    names : (marker,)
        As the file spells them.
    present : (time, marker) bool
        A marker that is never present counts as not there.
    mapping
        Joints and the names of their markers, which come before any set.
    """
    mapped, faults = _map_joints(names, present, mapping)
    performers = _split_performers(names)
    best, best_score, taken = Choice("none", mapped), (0, 0), ""
    for performer, members in performers.items():
        index = _index_names(names, members, present)
        for marker_set in MARKER_SETS:
            recipes = _find_recipes(marker_set, index, present) | mapped
            choice = Choice(marker_set.name, recipes)
            score = (len(choice.joints), len(marker_set.known & index.keys()))
            if score > best_score:
                best, best_score, taken = choice, score, performer
    notes = []
    name = best.marker_set
    if mapped:
        only = best.recipes.keys() == mapped.keys()
        name = "the given map" if only else f"{name} and the given map"
        notes.append(f"By the given map: {', '.join(mapped)}.")
    bodies = [repr(performer) for performer, own in performers.items() if len(own) >= 6]
    if len(bodies) > 1:
        notes.append(f"Of the performers {', '.join(bodies)} in the file {taken!r} was taken.")
    return Choice(name, best.recipes, tuple(notes), tuple(faults))


def place_joints(position: NDArray[np.float64], choice: Choice) -> NDArray[np.float64]:
    """Return the 21 joints, (time, 21, 3), from the markers in metres."""
    given = {
        # One marker alone is no copy: a take may be long.
        point: position[:, recipe[0]] if len(recipe) == 1 else position[:, recipe].mean(axis=1)
        for point, recipe in choice.recipes.items()
    }
    points = place_points(given)
    missing = np.full((len(position), 3), np.nan)
    return np.stack([points.get(joint, missing) for joint in JOINTS], axis=1)


def nearest_names(name: str, names: Sequence[str]) -> list[str]:
    """Return up to three of `names` that look like `name`, whatever their case.

    Where none does, and a letter says as much as a word (kanji), up to eight that share one.
    """
    folded = {other.casefold(): other for other in reversed(names)}
    near = get_close_matches(name.casefold(), folded, n=3)
    if not near and not name.isascii():
        near = get_close_matches(name.casefold(), folded, n=8, cutoff=0.3)
    return [folded[other] for other in near]


def _map_joints(
    names: Sequence[str], present: NDArray[np.bool_], mapping: Sequence[tuple[str, Sequence[str]]]
) -> tuple[dict[str, Recipe], list[str]]:
    """Return the markers of each mapped joint, and what is wrong with the mapping."""
    ways = (
        [unicodedata.normalize("NFC", name) for name in names],
        [bare_name(name) for name in names],
        [bare_name(name) for name in without_shared_prefixes(names)],
    )
    place: dict[str, int] = {}
    for way in ways:  # a name as it is spelt goes before one that is only like it
        for i, name in enumerate(way):
            place.setdefault(name, i)
    recipes, faults = {}, []
    for joint, markers in mapping:
        spelt = [unicodedata.normalize("NFC", marker) for marker in markers]
        found = [place.get(marker, place.get(bare_name(marker))) for marker in spelt]
        for marker, i in zip(markers, found, strict=True):
            if i is None:
                near = nearest_names(marker, names)
                hint = f"; near it: {', '.join(near)}" if near else ""
                faults.append(f"the map gives {joint} = {marker!r}, not in the file{hint}")
            elif not present[:, i].any():
                faults.append(f"the map gives {joint} = {marker!r}, missing in every frame")
        if None not in found:
            recipes[joint] = tuple(found)
    return recipes, faults


def _split_performers(names: Sequence[str]) -> dict[str, list[int]]:
    """Return the markers of each prefix that ends in a colon, in the order of the file."""
    performers: dict[str, list[int]] = {}
    for i, name in enumerate(names):
        performers.setdefault(name.rpartition(":")[0].strip(), []).append(i)
    return performers or {"": []}


def _index_names(
    names: Sequence[str], members: Sequence[int], present: NDArray[np.bool_]
) -> dict[str, int]:
    """Return where each bare name stands, of equal names the first that is ever present."""
    short = without_shared_prefixes([names[i].rpartition(":")[2].strip() for i in members])
    index: dict[str, int] = {}
    for i, name in zip(members, short, strict=True):
        if name and present[:, i].any():
            index.setdefault(bare_name(name), i)
    return index


def _find_recipes(
    marker_set: MarkerSet, index: Mapping[str, int], present: NDArray[np.bool_]
) -> dict[str, Recipe]:
    """Return the markers of each point; what is there in few frames only where it adds joints."""
    often, ever = {}, {}
    for point, ways in marker_set.points.items():
        found = [tuple(index[name] for name in way) for way in ways if index.keys() >= set(way)]
        shares = [float(present[:, recipe].all(axis=1).mean()) for recipe in found]
        if shares and max(shares) > 0:
            ever[point] = found[shares.index(max(shares))]
            if max(shares) >= 0.5:
                ever[point] = next(r for r, s in zip(found, shares, strict=True) if s >= 0.5)
                often[point] = ever[point]
    more = len(Choice("", ever).joints) > len(Choice("", often).joints)
    return ever if more else often
