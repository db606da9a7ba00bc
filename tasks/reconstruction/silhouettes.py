"""Tell the performer from the background: silhouettes (digitization paper, section 2.2).

    chroma  (default) A pixel is background where some brightness of the background explains its
            color: brightness and chroma distortion of Horprasert, Harwood and Davis, "A statistical
            approach for real-time robust background subtraction and shadow detection" (1999). The
            outline is then found to a pixel: beside it, a pixel is the performer's where its
            color is nearer to the performer's color around it than to the background's, which is
            taken as dark as the background around it is just now, so that a shadow is none; or
            where it is neither, nor a mixture: a hand of another color than the trunk behind it.
    crcb    The paper's rule: the difference of Cr and Cb from the background, against a fixed
            threshold. It swells the outline by a pixel, and a deep shadow is the performer to it.

Both compare pictures smoothed by 1-2-1, which is less than the camera and its codec did already.
A frame is judged by itself, so that a take may be cut into blocks anywhere. Before a backdrop
without color a frame is looked at twice: `tasks.reconstruction.regions.colorless`.
"""

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Lt
from numpy.typing import NDArray

from storage import open_archive
from storage.blocks import Written, write_block
from storage.formats.capture.capture import Capture, capture_of
from tasks.capture.backgrounds import Background, measure_gain, smooth
from tasks.capture.empty_stages import check_telling, read_backgrounds
from tasks.capture.films import (
    compared_frames,
    grid_of,
    largest_image,
    projection_of,
    read_films_and_masks,
)
from tasks.capture.screens import key_fault
from tasks.engine.progress import within
from tasks.engine.settings import NotNegative, check_ranges
from tasks.engine.threads import side_by_side
from tasks.reconstruction.regions.colorless import expect_performer, has_no_color
from tasks.reconstruction.regions.components import box_around, clean_region
from tasks.reconstruction.regions.differences import Planes, differ_in_chroma, differ_in_color
from tasks.reconstruction.regions.holes import fill_holes
from tasks.reconstruction.regions.masks import color_rim, silhouettes_of
from tasks.reconstruction.regions.noted import note_masks, note_outlines, nothing_noted
from tasks.reconstruction.regions.outlines import draw_outline
from tasks.reconstruction.regions.pixels import take_pixels


@dataclass(frozen=True)
class SilhouetteSettings:
    """Everything that changes a silhouette, and nothing that does not.

    Raises
    ------
    ValueError
        If the rule is unknown or a number out of its range; every fault is said.
    """

    background: Literal["given", "film"] = "given"
    """What tells the empty stage: the folder `background`, or the film itself. In the film the
    performer has to leave every place at some time."""

    key: str = ""
    """The color of a blue or green screen, such as "#00b140", or "auto"; empty without one. With a
    screen no empty stage has to be filmed."""

    rule: Literal["chroma", "crcb"] = "chroma"
    """How the performer is told from the background. `chroma` measures best on outline and shadows
    together; `crcb` is the paper's rule."""

    threshold: NotNegative = 18.0
    """Distance of a color from every brightness of the background above which a pixel may be the
    performer [levels of 0 to 255]. 14 to 22 differ by 0.001 of overlap."""

    noise_levels: NotNegative = 5.0
    """How many times the noise of the background at the pixel the threshold is at least [standard
    deviations]. Chosen by eye on the shared captures; not measured."""

    darkest: Annotated[float, Gt(0), Le(1)] = 0.5
    """How much of its brightness the background keeps in the deepest shadow [share]. Chosen by eye
    on the shared captures; not measured."""

    brightest: Annotated[float, Ge(1)] = 1.3
    """How many times its brightness the background may shine [factor]. Chosen by eye on the shared
    captures; not measured."""

    cut: Annotated[float, Gt(0), Lt(1)] = 0.46
    """How far on the way from the background's color to the performer's the outline is drawn
    [share]. It is half, less a little, so that on four rendered captures as much is lost as is
    added. This one matters: 0.5 costs 0.005 of overlap, 0.35 and 0.58 cost 0.02."""

    other_color: NotNegative = 27.0
    """Distance of a color from all mixtures of the performer's around it and the background's above
    which it is the performer's too [levels of 0 to 255]. A hand that shows beside a trunk is too
    thin to be looked at by itself. On twelve generated captures 27 finds a sixth to two thirds of
    what was missing of what is thinner than five pixels; 22 finds more and adds more that is not
    there, 18 costs 0.002 of overlap."""

    reach_px: Annotated[int, Ge(2), Le(50)] = 3
    """Half width of the window in which the colors beside the outline are looked for. Chosen by eye
    on the shared captures; not measured."""

    passes: Annotated[int, Ge(0), Le(50)] = 2
    """How often the outline is drawn, which moves it by a pixel at most [passes]. Sharp pictures
    need one; in blurred ones (sigma 1 to 1.6 pixels) a second wins 0.01 of overlap."""

    crcb_threshold: NotNegative = 18.0
    """Difference of Cr or Cb above which `crcb` sees the performer [levels of 0 to 255]. The paper
    gives none: 18 had the best overlap of 13.5, 18 and 22.5, over four rendered captures."""

    component_share: NotNegative = 8e-4
    """A region smaller than this is removed [share of the picture]. It is 60 pixels of 320 x 240;
    chosen by eye on the shared captures, not measured."""

    hole_share: NotNegative = 1e-4
    """A hole smaller than this is filled [share of the picture]. It is 8 pixels of 320 x 240;
    chosen by eye on the shared captures, not measured."""

    grow_px: Annotated[float, Ge(-50), Le(50)] = 0.0
    """How far the outline of given masks is moved outward [px]; negative: inward. `shosa doctor`
    tells by how much masks are too narrow. Silhouettes that are found are not changed."""

    holes: Literal["keep", "fill"] = "keep"
    """Whether holes are filled behind which the other cameras see a body: a print of the stage's
    color. Gaps that only one camera sees may be filled with them. `shosa doctor` tells where there
    are such holes."""

    def __post_init__(self) -> None:
        check_ranges(self)
        if fault := key_fault(self.key):
            raise ValueError(fault)
        if self.key and self.background != "given":
            raise ValueError(
                f'key is {self.key!r} and background "{self.background}": a screen and a film '
                "without one exclude each other, set one of them"
            )


DEFAULT = SilhouetteSettings()
"""The settings of silhouettes where nobody gave others."""


def extract_silhouettes(
    frames: NDArray[np.uint8],
    background: Background,
    settings: SilhouetteSettings = DEFAULT,
    expected: NDArray[np.bool_] | None = None,
    into: NDArray[np.bool_] | None = None,
) -> NDArray[np.bool_]:
    """Return where each frame of a camera shows the performer.

    Parameters
    ----------
    frames : (time, row, column, 3) uint8
        RGB, as filmed; any block of a take.
    background
        Of the same camera: `tasks.capture.backgrounds.make_background`.
    settings
        The rule and its numbers.
    expected : (time, row, column) bool, optional
        Pixels that are the performer's as the other cameras tell: `expected_of_all`.
    into : (time, row, column) bool, optional
        Where they are written, all False before; a new array where it is not given.

    Returns
    -------
    (time, row, column) bool
        True where a pixel shows the performer. A frame's silhouette depends on that frame, the
        background and what is expected alone.

    Raises
    ------
    ValueError
        The frames are no pictures, or of another size than the background.
    """
    _check_frames(frames, background)
    silhouettes = np.zeros(frames.shape[:3], np.bool_) if into is None else into
    held = Planes(background)
    for n, (frame, silhouette) in enumerate(zip(frames, silhouettes, strict=True)):
        image = smooth(frame, held.planes)
        seed = _seed(image, background, held, settings)
        if expected is not None:
            seed |= expected[n]
        box = box_around(seed, 2 * settings.reach_px)
        if box is None:
            continue
        least = settings.component_share * seed.size, settings.hole_share * seed.size
        region = seed[box].copy()
        if settings.rule == "chroma":
            corner = box[0].start, box[1].start
            surely = None if expected is None else expected[n][box]
            region = _outlined(region, corner, held, least, settings, surely)
        cleaned = np.empty(region.shape, np.bool_)
        clean_region(region, least, cleaned)
        silhouette[box] = cleaned
    return silhouettes


def looked_at_twice(
    backgrounds: Sequence[Background], settings: SilhouetteSettings = DEFAULT
) -> list[bool]:
    """Return of which cameras frames are looked at twice: those whose backdrop has no color."""
    return [
        settings.rule == "chroma" and has_no_color(background, settings.threshold)
        for background in backgrounds
    ]


def expected_of_all(
    films: Sequence[NDArray[np.uint8]],
    backgrounds: Sequence[Background],
    capture: Capture,
    settings: SilhouetteSettings = DEFAULT,
) -> list[NDArray[np.bool_] | None]:
    """Return which pixels of each camera the cameras together tell to be the performer's.

    Parameters
    ----------
    films : sequence of (time, row, column, 3) uint8
        RGB, of the same moments, an array a camera.
    backgrounds
        Of each camera.
    capture, settings
        Whose cameras and volume these are; the rule and its numbers.

    Returns
    -------
    list of (time, row, column) bool
        None of a camera that is not `looked_at_twice`.
    """
    twice = looked_at_twice(backgrounds, settings)
    if not any(twice):
        return [None] * len(films)
    where = projection_of(capture.cameras), grid_of(capture)
    expected = expect_performer(films, backgrounds, *where)
    return [
        each[:, : film.shape[1], : film.shape[2]] if is_needed else None
        for each, film, is_needed in zip(expected, films, twice, strict=True)
    ]


def _check_frames(frames: NDArray[Any], background: Background) -> None:
    """Say what is wrong with frames that cannot be compared with the background."""
    if frames.dtype != np.uint8 or frames.ndim != 4 or frames.shape[3] != 3:
        raise ValueError(
            f"a {frames.dtype} array of shape {frames.shape} is no film; "
            "(time, row, column, 3) uint8 is wanted"
        )
    rows, columns = background.color.shape[:2]
    if frames.shape[1:3] != (rows, columns):
        raise ValueError(
            f"the frames are {frames.shape[2]} x {frames.shape[1]} and the background is "
            f"{columns} x {rows}; bring the background of the same camera"
        )


def _seed(
    image: NDArray[np.uint8], background: Background, held: Planes, settings: SilhouetteSettings
) -> NDArray[np.uint8]:
    """Return the pixels that may show the performer: 1, the others 0."""
    if settings.rule == "crcb":
        threshold = np.float32(settings.crcb_threshold)
        differ_in_chroma(image, background.color, threshold, held.seed)
        return held.seed
    limits = np.array(
        [
            measure_gain(image, background),
            settings.threshold,
            settings.noise_levels,
            settings.darkest,
            settings.brightest,
        ],
        np.float32,
    )
    differ_in_color(held.planes, held.behind, background.noise, limits, held.seed)
    return held.seed


def _outlined(
    seed: NDArray[np.uint8],
    corner: tuple[int, int],
    held: Planes,
    least: tuple[float, float],
    settings: SilhouetteSettings,
    expected: NDArray[np.bool_] | None,
) -> NDArray[np.uint8]:
    """Return the seed, which begins at a corner, with its outline where the colors meet.

    Where the performer is expected, one off all mixtures by the threshold is another color.
    """
    found = np.empty(seed.shape, np.bool_)
    clean_region(seed, least, found)
    inside = found.view(np.uint8)
    rule = settings.reach_px, settings.cut, settings.other_color
    closer = settings.reach_px, settings.cut, min(settings.other_color, settings.threshold)
    for _ in range(settings.passes):
        before = inside
        inside = draw_outline(before, held.planes, held.behind, corner, rule)
        if expected is not None:
            inside |= draw_outline(before, held.planes, held.behind, corner, closer) & expected
    return inside


def extract_block(
    archive: str, capture: str, digest: str, into: str, start: int, end: int,
    settings: SilhouetteSettings,
) -> Written:  # fmt: skip
    """Write the silhouettes of all cameras from frame `start` to before `end` as a block.

    Parameters
    ----------
    archive
        Where the block goes.
    capture, digest
        The folder, and the digest of what is in it.
    into
        Path of the block in the archive.
    settings
        The rule and its numbers.

    Returns
    -------
    Written
        The array `silhouette` is (time, camera, row, column / 8),
        packed along the columns; beside an image smaller than the others it is False. `color` is
        (pixel, 3) uint8, RGB, of the silhouettes' pixels in their order: what coloring needs of
        the films, so that they are decoded once. `stale` (time, camera, row, column / 8) has, of
        the `compared_frames` among these, the outlines that are of the background alone. `filled`
        (time, camera) is how many pixels of each silhouette were a hole (`regions.holes`). `sure`
        (camera,) is the share of each picture in which a background is no guess.

    Raises
    ------
    InputError
        If the capture cannot be read, or nothing tells the performer from the stage.
    """
    begun = time.monotonic()
    source = capture_of(capture, digest)
    check_telling(source, settings.background, settings.key)
    backgrounds: list[Background] = []  # where masks say who the performer is
    if not source.masks:
        backgrounds = read_backgrounds(source, settings.background, settings.key)
    twice = looked_at_twice(backgrounds, settings)
    rows, columns = largest_image(source.cameras)
    packed = np.zeros((end - start, len(source.cameras), rows, -(-columns // 8)), np.uint8)
    compared = [n for n in compared_frames(source.frames) if start <= n < end]
    noted = nothing_noted(compared, len(source.cameras), (rows, columns))
    filled = np.zeros((end - start, len(source.cameras)), np.int64)
    projection, grid = projection_of(source.cameras), grid_of(source)
    color: list[NDArray[np.uint8]] = []
    for first, films, masks in read_films_and_masks(source, start, end):
        ends = [(n - start) / (end - start) for n in (first, first + len(films[0]))]
        middle = sum(ends) / 2.0 if any(twice) else ends[0]
        with within(ends[0], middle):
            expected = expected_of_all(films, backgrounds, source, settings)
        found = np.zeros((len(films[0]), len(films), rows, columns), np.bool_)

        def extract(
            camera: int, first: int = first, films: Any = films, masks: Any = masks,
            expected: Any = expected, found: Any = found,
        ) -> None:  # fmt: skip
            film = films[camera]
            own = found[:, camera, : film.shape[1], : film.shape[2]]
            if masks:
                own[:] = silhouettes_of(masks[camera], settings.grow_px)
                note_masks(noted, camera, first, film, masks[camera], own)
                for each, mask, silhouette in zip(film, masks[camera], own, strict=True):
                    color_rim(each, mask, silhouette)
            else:
                extract_silhouettes(film, backgrounds[camera], settings, expected[camera], own)
                note_outlines(noted, camera, first, film, backgrounds[camera].color, own)

        def finish(frame: int, first: int = first, films: Any = films, found: Any = found) -> Any:
            if settings.holes == "fill" and not source.masks:  # those are taken as they are
                filled[first - start + frame] = fill_holes(found[frame], projection, grid)
            bits = packed[first - start + frame]
            bits[:] = np.packbits(found[frame], axis=-1)
            return [take_pixels(each, film[frame]) for each, film in zip(bits, films, strict=True)]

        with within(middle, ends[1]):
            side_by_side(extract, range(len(films)))
            for of_cameras in side_by_side(finish, range(len(films[0]))):
                color += of_cameras
    arrays = {
        "silhouette": packed,
        "color": np.concatenate(color),
        "stale": noted.stale,
        "masks": noted.masks,
        "edges": noted.edges,
        "filled": filled,
        "sure": np.array([background.sure for background in backgrounds]),
    }
    return write_block(open_archive(archive).place, into, (start, end), arrays, begun)
