"""Measure what a search finds, and what its distances mean, on dance whose truth is known.

    python -m tests.benchmarks.similarity.retrieval [--data FOLDER] [--quick]

Recorded dance is `mocap` below the shared data; without it only generated dance is measured.
docs/retrieval.md has the tables and what was concluded from them.
"""

import argparse
import itertools
import sys
from collections import defaultdict
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.retrieval.meaning.chance import Chance, measure_chance
from tasks.retrieval.meaning.levels import LEVELS, level_thresholds
from tasks.retrieval.normalization import PARTS
from tasks.retrieval.searching import Match, Query, SearchSettings, search_takes
from tasks.retrieval.segments import PackedTake
from tests.benchmarks.recordings import data_folder
from tests.benchmarks.similarity import truth
from tests.benchmarks.similarity.path_constraints import CONSTRAINTS, warp_by
from tests.benchmarks.similarity.truth import Danced, cut, overlap, style_of

ALL = 10_000
"""More matches than there are."""
LONG = 90
"""How many frames a clip of recorded dance has: three seconds."""
SHOWN_PARTS = [part for part in PARTS if not part.startswith("left-")]

Recorded = dict[str, tuple[PackedTake, NDArray[np.float64]]]
"""Takes by name, and their positions (sample, 21, 3) in metres."""
Measured = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]
"""Of a part: distances to other dance; distances to the same dancer's salsa, and whether the
partner repeats there too."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure everything and print the tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    shared = data_folder()
    parser.add_argument("--data", type=Path, default=shared / "mocap", help="recorded dance")
    parser.add_argument("--quick", action="store_true", help="a small part of everything")
    options = parser.parse_args(arguments)
    quick = options.quick
    takes, clips = truth.generate(*((2, 2) if quick else (5, 4)))
    asked = [clip for clip in clips if clip.take.endswith("-1")][:: 9 if quick else 1]
    parts = SHOWN_PARTS[:1] if quick else SHOWN_PARTS
    every = 8 if quick else 1
    if options.data.is_dir():
        recorded = truth.read_recorded(options.data)
        measured = measure_parts(recorded, parts, every)
        show("what the levels are made from", reach_table(recorded, measured, every))
        show("altered clips of recorded dance", variant_table(recorded, 28 // every))
        show("salsa: is a match danced by the partner too?", witness_table(measured))
        show("salsa: is the partner's part found?", partner_table(recorded, every))
        show("chances told of other dance", chance_table(recorded, max(1, 10 // every)))
    else:
        sys.stdout.write(f"There is no recorded dance at {options.data}: it is left out.\n")
        measured = {}
    show("share of matches within each level", level_table(takes, clips, asked, measured, parts))
    show("the same movement, generated performers", movement_table(takes, clips, asked))
    show("path constraints, generated performers", constraint_table(takes, clips, asked[::3]))


def show(title: str, lines: Iterable[str]) -> None:
    """Print a table under its title."""
    sys.stdout.write(f"\n{title}\n")
    for line in lines:
        sys.stdout.write(f"  {line}\n")
        sys.stdout.flush()


def found(query: Query, takes: Iterable[PackedTake], settings: SearchSettings) -> list[Match]:
    """Return the matches of a query on one thread."""
    return search_takes(query, takes, settings, threads=1).matches


def judge(match: Match, clip: Danced, clips: Sequence[Danced]) -> tuple[str, Danced | None]:
    """Return what a match is to the query `clip`: same, like, neither or false; and its clip."""
    at = (match.start, match.end)
    near = max(
        (each for each in clips if each.take == match.take),
        key=lambda each: overlap((each.start, each.end), at),
    )
    if near.movement == clip.movement:
        if overlap((near.start, near.end), at) < 0.5:
            return "neither", None
        return ("same" if near.performer == clip.performer else "like"), near
    kind = truth.KINDS.get(clip.movement)
    alike = kind is not None and truth.KINDS.get(near.movement) == kind
    return ("neither" if alike else "false"), None


def average_precision(judged: Sequence[tuple[str, Danced | None]], true: int) -> float:
    """Return the mean of the precisions at which each true clip is found; the first time counts."""
    seen: set[Danced] = set()
    places, total = 0, 0.0
    for what, near in judged:
        if what == "neither" or (near is not None and near in seen):
            continue
        places += 1
        if near is not None:
            seen.add(near)
            total += len(seen) / places
    return total / true


def movement_table(
    takes: dict[str, PackedTake], clips: Sequence[Danced], asked: Sequence[Danced]
) -> Iterable[str]:
    """Yield recall, mAP and collapsed matches, by part and steps."""
    yield f"{'part':10} {'steps':6} {'mAP':>6} {'R@10':>6} {'R@all':>6} {'< 1/2':>6} {'< 1/10':>7}"
    for part in ("whole", "arms", "feet"):
        for steps in ("slope", "paper"):
            settings = SearchSettings(part=part, steps=steps, top=60)
            answers = []
            for clip in asked:
                others = [take for name, take in takes.items() if name != clip.take]
                query = cut(takes[clip.take], clip.start, clip.end)
                answers.append((clip, found(query, others, settings)))
            yield f"{part:10} {steps:6} " + retrieval_line(answers, clips)


def retrieval_line(answers: Sequence[tuple[Danced, list[Match]]], clips: Sequence[Danced]) -> str:
    """Return mAP, recall among ten and among as many as are true, and collapsed shares."""
    figures = []
    for clip, matches in answers:
        true = sum(c.movement == clip.movement and c.take != clip.take for c in clips)
        judged = [judge(match, clip, clips) for match in matches]
        hits = [len({near for _, near in judged[:k] if near}) for k in (10, true)]
        long = np.array([m.end - m.start + 1 for m in matches[:10]]) / (clip.end - clip.start + 1)
        figures.append(
            (average_precision(judged, true), hits[0] / min(10, true), hits[1] / true,
             (long < 0.5).mean(), (long < 0.1).mean())
        )  # fmt: skip
    a, b, c, d, e = np.mean(figures, axis=0)
    return f"{a:6.3f} {b:6.3f} {c:6.3f} {d:6.3f} {e:7.3f}"


def constraint_table(
    takes: dict[str, PackedTake], clips: Sequence[Danced], asked: Sequence[Danced]
) -> Iterable[str]:
    """Yield the same for other constraints of the path, whole body."""
    yield f"{'constraint':34} {'mAP':>6} {'R@10':>6} {'R@all':>6} {'< 1/2':>6} {'< 1/10':>7}"
    for name, constraint in CONSTRAINTS.items():
        answers = []
        for clip in asked:
            query = cut(takes[clip.take], clip.start, clip.end)
            matches: list[Match] = []
            for other, take in takes.items():
                if other != clip.take:
                    matches += [
                        Match(other, first, last, near)
                        for first, last, near in warp_by(constraint, query, take)
                    ]
            matches.sort(key=lambda match: match.distance)
            answers.append((clip, matches[:60]))
        yield f"{name:34} " + retrieval_line(answers, clips)


def variant_table(recorded: Recorded, count: int) -> Iterable[str]:
    """Yield how clips that were altered and put into other dance are found again."""
    rng = np.random.default_rng(5)
    figures: dict[tuple[str, str], list[tuple[bool, float, float]]] = defaultdict(list)
    names = list(recorded)
    for number in range(count):
        name = names[number % len(names)]
        take, position = recorded[name]
        start = int(rng.integers(0, len(position) - LONG))
        others = [t for n, (t, _) in recorded.items() if n != name]
        filler = next(p for n, (_, p) in recorded.items() if style_of(n) != style_of(name))
        query = cut(take, start, start + LONG - 1)
        made = truth.variants(position, start, start + LONG - 1, rng)
        for steps in ("slope", "paper"):
            best = found(query, others, SearchSettings(steps=steps, top=1))[0].distance
            for what, variant in made.items():
                place, first, last = truth.planted(what, filler, variant)
                mirror = what == "mirrored"
                settings = SearchSettings(steps=steps, mirror=mirror, top=1)
                match = found(query, [place], settings)[0]
                near = overlap((match.start, match.end), (first, last)) >= 0.5
                figures[what, steps].append((near, match.distance, best))
    levels = level_thresholds(SearchSettings())
    yield (f"{'altered':26} {'first':>6} {'place':>6} {'median':>7} {'largest':>8} "
           f"{'same':>5} {'like':>5} | paper: {'first':>6} {'place':>6}")  # fmt: skip
    for what in dict.fromkeys(what for what, _ in figures):
        near, distance, best = map(np.array, zip(*figures[what, "slope"], strict=True))
        paper, far, rival = map(np.array, zip(*figures[what, "paper"], strict=True))
        within = [(distance < levels[level]).mean() for level in LEVELS]
        yield (
            f"{what:26} {(near & (distance < best)).mean():6.2f} {near.mean():6.2f} "
            f"{np.median(distance):7.3f} {distance.max():8.3f} {within[0]:5.2f} {within[1]:5.2f} |"
            f"        {(paper & (far < rival)).mean():6.2f} {paper.mean():6.2f}"
        )


def witnessed(
    recorded: Recorded, settings: SearchSettings, every: int, long: int = LONG
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Return the distances of all matches of salsa clips in other takes of the same dancer, and
    whether the partner's whole body repeats there, among the nearest tenth of all such places.
    """
    distances, confirmed = [], []
    for dancers in (truth.LEADS, truth.FOLLOWS):
        for name in dancers:
            take, partner = recorded[name][0], recorded[truth.PARTNER[name]][0]
            others = [recorded[other][0] for other in dancers if other != name]
            for start in range(0, take.frames - long, long * every):
                query = cut(take, start, start + long - 1)
                matches = found(query, others, settings)
                witness = cut(partner, start, start + long - 1)
                near = np.array([_near_place(recorded, witness, match) for match in matches])
                distances += [match.distance for match in matches]
                confirmed += (near <= np.quantile(near, 0.1)).tolist()
    return np.array(distances), np.array(confirmed)


def _near_place(recorded: Recorded, witness: Query, match: Match) -> float:
    """Return the distance of the partner's clip to where the partner of a match was then."""
    partner = recorded[truth.PARTNER[match.take]][0]
    start, end = max(0, match.start - 8), min(partner.frames, match.end + 9)
    rows = partner.rows[:, start:end]
    place = PackedTake("place", rows, truth.RATE_HZ, end - start, partner.joints_present)
    matches = found(witness, [place], SearchSettings(top=1))
    return matches[0].distance if matches else 1.0


def share_true(confirmed: NDArray[np.bool_]) -> float:
    """Return the share of matches that are repeats: a tenth is confirmed by chance."""
    return float((confirmed.mean() - 0.1) / 0.9) if len(confirmed) else float("nan")


def witness_table(measured: dict[str, Measured]) -> Iterable[str]:
    """Yield, by distance, how many matches the partner confirms."""
    yield f"{'part':10} {'distance':>13} {'matches':>8} {'repeats':>8} {'up to here':>11}"
    edges = [0.0, 0.03, 0.04, 0.05, 0.06, 0.075, 0.09, 0.12]
    for part in [part for part in ("whole", "arms", "feet") if part in measured]:
        _, distance, confirmed = measured[part]
        for low, high in itertools.pairwise(edges):
            inside, below = (distance >= low) & (distance < high), distance < high
            yield (
                f"{part:10} {low:6.3f}-{high:6.3f} {inside.sum():8} "
                f"{share_true(confirmed[inside]):8.2f} {share_true(confirmed[below]):11.2f}"
            )


def partner_table(recorded: Recorded, every: int) -> Iterable[str]:
    """Yield how near the partner's part is at the same time, as danced and mirrored."""
    yield f"{'part':10} {'as danced':>10} {'place':>6} {'mirrored':>9} {'place':>6}"
    for part in ("whole", "arms", "legs", "feet"):
        figures = []
        for name in truth.LEADS:
            take, partner = recorded[name][0], recorded[truth.PARTNER[name]][0]
            for start in range(0, take.frames - LONG, LONG * every):
                query = cut(take, start, start + LONG - 1)
                settings = SearchSettings(part=part, mirror=True, top=ALL)
                both = found(query, [partner], settings)
                figures.append([])
                for mirrored in (False, True):
                    alone = [m for m in both if m.mirrored == mirrored] or both
                    shares = [overlap((m.start, m.end), (start, start + LONG - 1)) for m in alone]
                    at = int(np.argmax(shares))
                    figures[-1] += [alone[at].distance, at / max(len(alone) - 1, 1)]
        a, b, c, d = np.median(figures, axis=0)
        yield f"{part:10} {a:10.3f} {b:6.2f} {c:9.3f} {d:6.2f}"


def chance_table(recorded: Recorded, queries: int) -> Iterable[str]:
    """Yield how often a chance is met that was told, on dance that was not looked at.

    The chance is measured on half of the clips of other dances, and met on all of them.
    """
    wanted = (0.1, 0.03, 0.01, 0.003, 0.001, 0.0003, 0.0001)
    heads = " ".join(f"{f'1:{1 / each:,.0f}':>8}" for each in wanted)
    yield f"{'part':10} {'frames':>6} {'clips':>6} {heads}   observed / told"
    rng = np.random.default_rng(1)
    for part in ("whole", "feet", "right-arm"):
        for long in (30, 60):
            told = []
            settings = SearchSettings(part=part, top=ALL)
            for name, (take, _) in recorded.items():
                others = [t for n, (t, _) in recorded.items() if style_of(n) != style_of(name)]
                for start in np.linspace(0, take.frames - long, queries).astype(int):
                    query = cut(take, int(start), int(start) + long - 1)
                    whole = measure_chance(query, others, settings, threads=1).distance
                    part_of = np.sort(rng.choice(whole, len(whole) // 2, replace=False))
                    chance = Chance(part_of, len(whole))
                    told += [chance.of(match.distance) for match in found(query, others, settings)]
            met = np.array([each for each in told if each is not None])
            if not len(met):
                yield f"{part:10} {long:6}        too few clips to tell a chance"
                continue
            shares = " ".join(f"{(met <= each).mean() / each:8.2f}" for each in wanted)
            yield f"{part:10} {long:6} {len(met):6} {shares}"


def measure_parts(recorded: Recorded, parts: Sequence[str], every: int) -> dict[str, Measured]:
    """Return, by part, the distances of recorded dance whose truth is known."""
    measured = {}
    for part in parts:
        settings = SearchSettings(part=part, top=ALL)
        other = np.array(list(_of_other_dance(recorded, settings, every)))
        measured[part] = other, *witnessed(recorded, settings, every)
    return measured


def reach_table(recorded: Recorded, measured: dict[str, Measured], every: int) -> Iterable[str]:
    """Yield what the levels are made from: how near other dance is, how far repeats are."""
    shares = (0.0003, 0.001, 0.003, 0.01, 0.1, 0.5)
    heads = " ".join(f"{each:7g}" for each in shares)
    yield f"{'part or joint':16} other dance {heads}   repeats up to 0.7, 0.6, 0.5, 0.4 of all"

    def line(name: str, other: NDArray[np.float64]) -> str:
        return f"{name:16} {len(other):11} " + " ".join(
            f"{each:7.3f}" for each in np.quantile(other, shares)
        )

    for part, (other, distance, confirmed) in measured.items():
        order = np.argsort(distance)
        count = np.arange(1, len(order) + 1)
        repeats = (np.cumsum(confirmed[order]) / count - 0.1) / 0.9
        ends = [
            np.flatnonzero((repeats >= share) & (count >= 20)) for share in (0.7, 0.6, 0.5, 0.4)
        ]
        reach = " ".join(f"{distance[order[e[-1]]]:7.3f}" if len(e) else "      -" for e in ends)
        yield f"{line(part, other)}   {reach}"
    for joint in JOINTS if len(measured) > 1 else ():
        if joint[0] == "L":
            continue
        for hips in (0.0, 1e-6):  # with a weight of the legs, arms are compared from the hips too
            weights = {name: 0.0 for name in JOINTS} | {"RHip": hips, joint: 1.0}
            settings = SearchSettings(weights=tuple(weights.items()), top=ALL)
            other = np.array(list(_of_other_dance(recorded, settings, 2 * every)))
            yield line(joint + " (hips)" * (hips > 0), other)
    settings = SearchSettings(path_weight=0.2, top=ALL)
    yield line("whole, path 0.2", np.array(list(_of_other_dance(recorded, settings, every))))


def level_table(
    takes: dict[str, PackedTake],
    clips: Sequence[Danced],
    asked: Sequence[Danced],
    measured: dict[str, Measured],
    parts: Sequence[str],
) -> Iterable[str]:
    """Yield, by part and level, the shares of true and of false matches within it."""
    yield f"{'':22} {'generated':^31} {'recorded':^34}"
    yield (f"{'part':10} {'level':5} {'below':>6}      {'same':>7} {'other':>7} {'else':>8}"
           f"        {'other dance':>12} {'repeats':>8} {'found':>6}")  # fmt: skip
    for part in parts:
        settings = SearchSettings(part=part, top=ALL)
        judged: dict[str, list[float]] = defaultdict(list)
        for clip in asked:
            others = [take for name, take in takes.items() if name != clip.take]
            for match in found(cut(takes[clip.take], clip.start, clip.end), others, settings):
                judged[judge(match, clip, clips)[0]].append(match.distance)
        for level, reach in level_thresholds(settings).items():
            within = [np.mean(np.array(judged[what]) < reach) for what in ("same", "like", "false")]
            line = f"{part:10} {level:5} {reach:6.3f}      "
            line += "{:7.3f} {:7.3f} {:8.4f}".format(*within)
            if part in measured:
                other, distance, confirmed = measured[part]
                below = distance < reach
                repeats = share_true(confirmed[below])
                of_all = repeats * below.sum() / max(share_true(confirmed) * len(confirmed), 1.0)
                line += f"        {(other < reach).mean():12.4f} {repeats:8.2f} {of_all:6.2f}"
            yield line


def _of_other_dance(recorded: Recorded, settings: SearchSettings, every: int) -> Iterable[float]:
    """Yield the distances of clips of recorded dance to all clips of other dances."""
    for name, (take, _) in recorded.items():
        others = [t for n, (t, _) in recorded.items() if style_of(n) != style_of(name)]
        for long in (60, 105):
            for start in range(0, take.frames - long, long * every):
                query = cut(take, start, start + long - 1)
                yield from (match.distance for match in found(query, others, settings))


if __name__ == "__main__":
    main()
