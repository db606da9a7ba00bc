"""Say how often a clip of the archive is so near by chance, measured on the archive itself.

A distance alone does not tell whether a match means anything: a dancer who stands is near to
everybody who stands. So the query is searched for once more, *backwards in time*, in a sample of
the archive. A movement played backwards has the poses and the speeds of the movement, and is danced
nowhere; what it finds is near by chance. This is how searches of proteins are judged by reversed
sequences (Elias and Gygi 2007). Neither the query's own clip nor true matches have to be left out,
however many there are. A movement that is the same backwards, such as standing, finds itself: the
chance is large then, which is right.

The sample is cut into the disjoint clips that `search_takes` selects. Of n clips, the share whose
distance is at most x is the chance there. Below u, the distance that one in ten of them reaches,
the share is taken to fall as a power of the distance, as in a space of m dimensions,

    chance(x) = share(u) (x / u)^m,     1 / m = mean of log(u / x_i) over the k clips nearer than u

(Hill 1975), and never below the share that was seen. On recorded dance a chance so told of 1 in
1,000 is met half to four fifths as often: it is on the safe side. A log-normal tail fits noise
better, and on dance says 1 in 10,000 of what is met once in 1,000; a generalized Pareto tail errs
twice as far (docs/retrieval.md).

The matches to expect by chance are chance(x) times the clips of the archive, as the E-value of
searches of sequences (Karlin and Altschul 1990).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tasks.retrieval.normalization import PATH_ROWS
from tasks.retrieval.searching import Query, search_takes
from tasks.retrieval.segments import PackedTake
from tasks.retrieval.weighting import SearchSettings

SAMPLED = 100_000
"""How many samples of an archive are searched for what is near by chance. 55 minutes of dance, a
tenth of a second; a larger archive is sampled evenly."""
FEWEST_CLIPS = 50
"""How many clips must be compared before a chance is told. Chosen: ten of them are in the tail."""
_TAIL = 10
"""One clip in how many is in the tail that is fitted. With a third, chances of 1 in 1,000 were told
3 to 25 times too large on recorded dance; with a tenth, 1.2 to 2 times."""
_BEYOND = 100
"""How many times rarer than one clip of the sample a chance is told. So far the tail was checked,
with samples of 50 to 100 clips; what is rarer is told as this."""
_PIECE_IN_QUERIES = 16
"""How many times as long as the query a piece of a sampled take is. The ends of a piece, where no
whole match fits, are a few percent of it then."""


@dataclass(frozen=True, eq=False)
class Chance:
    """How near the clips of an archive are to a query by chance."""

    distance: NDArray[np.float64] = field(default_factory=lambda: np.empty(0))
    """(clip,) of the query backwards to each clip of the sample, ascending, statures."""
    clips: int = 0
    """How many such clips the whole archive has."""

    @property
    def can_be_told(self) -> bool:
        """Say whether the archive is large enough to tell a chance."""
        return len(self.distance) >= FEWEST_CLIPS

    def of(self, distance: float) -> float | None:
        """Return the share of the archive's clips that are as near by chance, above 0 and up to 1.

        Parameters
        ----------
        distance
            Of a match, statures.

        Returns
        -------
        float or None
            None where the archive has too few clips to tell.
        """
        if not self.can_be_told:
            return None
        count = len(self.distance)
        inside = max(count // _TAIL, FEWEST_CLIPS // 5)
        edge = float(self.distance[inside])
        seen = int(np.searchsorted(self.distance, distance, side="right")) / count
        if distance >= edge:
            return seen
        nearer = np.maximum(self.distance[:inside], np.finfo(float).tiny)
        falls = float(np.log(edge / nearer).sum())
        # of equal distances nothing can be fitted; one less than their number is without bias
        dimensions = (inside - 1) / falls if falls > 0 else 0.0
        told = inside / count * (max(distance, 0.0) / edge) ** dimensions
        return max(told, seen, self.least)

    @property
    def least(self) -> float:
        """The smallest chance that is told; what is rarer is told as this."""
        return 1 / (_BEYOND * len(self.distance))

    def in_words(self, distance: float) -> str:
        """Return the chance as `1 in 300`; `?` where it cannot be told."""
        chance = self.of(distance)
        if chance is None:
            return "?"
        if (clips := one_in(chance)) == 1:
            return "most"
        return f"{'< ' * (chance <= self.least)}1 in {clips:,}"

    def expected(self, distance: float) -> float | None:
        """Return how many matches as near are to be expected by chance in the whole archive."""
        chance = self.of(distance)
        return None if chance is None else chance * self.clips


def one_in(chance: float) -> int:
    """Return the clips of which one is so near by chance, in two digits and never too many."""
    clips = int(1 / chance + 1e-6)  # of 1 / 99, 99
    fine = 10 ** max(0, len(str(clips)) - 2)
    return clips // fine * fine


def measure_chance(
    query: Query,
    takes: Iterable[PackedTake],
    settings: SearchSettings | None = None,
    *,
    threads: int | None = None,
) -> Chance:
    """Return how near the clips of these takes are to a query by chance.

    The same takes, in the same order, give the same answer. Nothing is told of the steps `paper`,
    whose matches collapse to a few frames and are no clips that could be counted.

    Parameters
    ----------
    query, settings
        As of the search whose matches are judged; threshold and number of matches play no role.
    takes
        All that was searched.
    threads
        As of `search_takes`.

    Raises
    ------
    ValueError
        As `search_takes`.
    """
    takes = list(takes)
    samples = [take.rows.shape[1] for take in takes]
    chosen = choose_pieces(samples, query.rows.shape[1])
    pieces = [cut_piece(takes[which], first, count) for which, first, count in chosen]
    return measure_pieces(query, pieces, sum(samples), settings, threads=threads)


def measure_pieces(
    query: Query,
    pieces: Sequence[PackedTake],
    samples: int,
    settings: SearchSettings | None = None,
    *,
    threads: int | None = None,
) -> Chance:
    """Return the same from the pieces that `choose_pieces` chose of takes of so many samples."""
    settings = settings or SearchSettings()
    looked_at = sum(piece.rows.shape[1] for piece in pieces)
    if settings.steps != "slope" or not looked_at:
        return Chance()
    everything = replace(settings, threshold=None, top=looked_at)
    found = search_takes(_backwards(query), pieces, everything, threads=threads)
    distance = np.sort([match.distance for match in found.matches])
    return Chance(distance, round(len(distance) * samples / looked_at))


def choose_pieces(samples: Sequence[int], frames: int) -> list[tuple[int, int, int]]:
    """Return which pieces of takes are looked at: all, or evenly spread where they are many.

    Parameters
    ----------
    samples
        How many each take has.
    frames
        How many frames the query has, at the index rate.

    Returns
    -------
    list of (take, first, count)
        In samples, ascending.
    """
    counts = np.array(samples, np.int64)
    if counts.sum() <= SAMPLED:
        return [(which, 0, count) for which, count in enumerate(counts.tolist()) if count]
    long = _PIECE_IN_QUERIES * frames
    pieces = -(-counts // long)
    last = np.cumsum(pieces)
    chosen = np.arange(0, last[-1], counts.sum() / SAMPLED).astype(np.int64)
    found = []
    for piece, which in zip(chosen, np.searchsorted(last, chosen, side="right"), strict=True):
        first = int(piece - last[which] + pieces[which]) * long
        found.append((int(which), first, min(long, int(counts[which]) - first)))
    return found


def cut_piece(take: PackedTake, first: int, count: int) -> PackedTake:
    """Return a piece of a take as a take of its own."""
    rows = take.rows[:, first : first + count]
    return replace(take, name=f"{take.name}:{first}", rows=rows, frames=rows.shape[1])


def _backwards(query: Query) -> Query:
    """Return the query played backwards: all velocities point the other way."""
    rows = query.rows[:, ::-1].copy()
    rows[PATH_ROWS] *= -1
    return replace(query, rows=rows)
