"""How far a take is and how long it still takes: one estimate for all who show it.

What is expected of a stage was measured once; what is left is that, as fast as this take has been
so far on this machine. Blocks that were found done are not counted as fast.
"""

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

logger = logging.getLogger(__name__)

ASSEMBLING = "assembling"
"""What comes after the last stage, as if it were one: blocks become a version of the take."""

COMPILING = "compiling, once"
"""What stands in the place of a take while kernels are compiled, after an installation."""

_EXPECTED: dict[str, tuple[float, float]] = {
    "silhouettes": (0.5, 0.017),
    "carving": (0.0, 0.008),
    "coloring": (0.0, 0.010),
    "still_things": (0.3, 0.0),
    "initial_model": (2.0, 0.0),
    "pose_fitting": (2.0, 0.013),
    "final_labeling": (0.0, 0.0025),
    "provisional_labeling": (0.0, 0.005),
    "joint_tracks": (0.0, 0.0015),
    ASSEMBLING: (1.0, 0.006),
}
"""How long a stage takes: in any case, and for each frame [s].

Measured with `captures/plain` of the shared recordings on two cores; only how they compare matters.
"""

_FOUND_DONE = 0.05
"""Work that took less than this share of what was expected was found done. Chosen: a machine that
were so much faster would be told a time after its first stage only."""

_LEAST_DONE = 0.04
"""How much of a take has to be computed before a time is told [share]. Chosen, not measured."""


@dataclass(frozen=True)
class Moment:
    """How far a take is."""

    take: str
    """Empty where the moment is of a run of many takes; `COMPILING`, where it is of kernels."""
    stage: str
    """As a person says it."""
    frame: float
    """That the stage has come to; a share of its work, in frames."""
    frames: int
    share: float
    """Of the whole take that is done, 0 to 1; never less than before."""
    left_s: float | None
    """About how long it still takes [s]; None before that can be told."""

    def done(self) -> str:
        """Return how far its stage is, in words."""
        if self.take in ("", COMPILING):
            return f"{self.frame:.0f} of {self.frames} done"
        if self.stage == ASSEMBLING:
            return self.stage
        return f"{self.stage} {self.frame:.0f}/{self.frames} frames"

    def left(self) -> str:
        """Return how long it still takes, in words; nothing where that is not known."""
        return "" if self.left_s is None or self.share >= 1 else time_left(self.left_s)

    def said(self) -> str:
        """Return all of it in words."""
        return ", ".join(filter(None, [self.done(), self.left()]))


Watch = Callable[[Moment], None]

_WATCH: ContextVar[Watch | None] = ContextVar("watch", default=None)


@contextmanager
def watching(watch: Watch) -> Iterator[None]:
    """Let `watch` hear how far each take is that is digitized inside, in threads of this process.

    It may be called in several threads at once.
    """
    token = _WATCH.set(watch)
    try:
        yield
    finally:
        _WATCH.reset(token)


def show_watcher(moment: Moment) -> None:
    """Tell who watches this process, if anybody does."""
    watch = _WATCH.get()
    if watch is not None:
        watch(moment)


def tell_compiled(done: int, total: int) -> None:
    """Tell the log and who watches how many kernels are compiled, of how many."""
    if done == 0:
        logger.info(
            "The programs of the stages are compiled for this processor, once after an "
            "installation, beside the first take: it takes about a minute longer than others."
        )
    show_watcher(Moment(COMPILING, "", done, total, done / total, None))


@dataclass
class Estimate:
    """What is known of the progress of one take."""

    take: str
    frames: int
    _reached: dict[str, float] = field(default_factory=dict)
    _last_s: float = field(default_factory=time.monotonic)
    _computed: float = 0.0
    _spent_s: float = 0.0
    _share: float = 0.0

    def move(self, stage: str, frame: float) -> Moment:
        """Return how far the take is, now that a stage has come to a frame.

        Raises
        ------
        KeyError
            If nothing is expected of such a stage.
        """
        now_s = time.monotonic()
        work = self._expected_s(stage) * (frame - self._reached.get(stage, 0.0)) / self.frames
        if work > 0:
            self._reached[stage] = frame
            if now_s - self._last_s > _FOUND_DONE * work:
                self._computed += work
                self._spent_s += now_s - self._last_s
        self._last_s = now_s
        total = sum(map(self._expected_s, _EXPECTED))
        done = sum(
            self._expected_s(each) * reached / self.frames
            for each, reached in self._reached.items()
        )
        is_over = stage == ASSEMBLING and frame >= self.frames
        self._share = 1.0 if is_over else max(self._share, min(done / total, 0.99))
        left_s = None
        if self._computed > _LEAST_DONE * total:
            left_s = max(total - done, 0.0) * self._spent_s / self._computed
        name = stage.replace("_", " ")
        return Moment(self.take, name, frame, self.frames, self._share, left_s)

    def _expected_s(self, stage: str) -> float:
        always, a_frame = _EXPECTED[stage]
        return always + a_frame * self.frames


def time_left(seconds: float) -> str:
    """Return how long something still takes, no more exactly than it is known."""
    if seconds < 50:
        return "less than a minute left"
    if seconds < 90 * 60:
        return f"about {max(1, round(seconds / 60))} min left"
    return f"about {seconds / 3600:.1f} h left"
