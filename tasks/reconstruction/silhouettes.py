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
A frame is judged by itself, so that a take may be cut into blocks anywhere.
"""

import time
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import cv2
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
from tasks.engine.kernels import njit
from tasks.engine.progress import within
from tasks.engine.settings import NotNegative, check_ranges
from tasks.engine.threads import side_by_side
from tasks.reconstruction.regions.components import clean_region
from tasks.reconstruction.regions.holes import fill_holes
from tasks.reconstruction.regions.masks import MASK_FACTS, color_rim, mask_facts, silhouettes_of
from tasks.reconstruction.regions.outlines import draw_outline
from tasks.reconstruction.regions.pixels import take_pixels
from tasks.reconstruction.regions.stale_outlines import stale_outline

_BLACK = np.float32(1.0)
"""Square of a length that is added to that of the background's color [levels²]. It gives black,
which has no color, a direction that divides."""

_LUMA_OF_RED = np.float32(0.299)
"""Share of red in luma. ITU-R BT.601."""

_LUMA_OF_GREEN = np.float32(0.587)
"""Share of green in luma. ITU-R BT.601."""

_LUMA_OF_BLUE = np.float32(0.114)
"""Share of blue in luma. ITU-R BT.601."""

_CR_OF_RED = np.float32(0.713)
"""Factor from the difference of red and luma to Cr [factor]. ITU-R BT.601: 0.5 / (1 - 0.299)."""

_CB_OF_BLUE = np.float32(0.564)
"""Factor from the difference of blue and luma to Cb [factor]. ITU-R BT.601: 0.5 / (1 - 0.114)."""


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

    holes: Literal["keep", "fill"] = "keep"
    """Whether holes are filled behind which the other cameras see a body: a print of the stage's
    color. Gaps that only one camera sees may be filled with them: of a kimono 0.9 % of the labels
    become wrong. `shosa doctor` tells where there are such holes."""

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

    Returns
    -------
    (time, row, column) bool
        True where a pixel shows the performer. A frame's silhouette depends on that frame and
        the background alone.

    Raises
    ------
    ValueError
        The frames are no pictures, or of another size than the background.
    """
    _check_frames(frames, background)
    silhouettes = np.zeros(frames.shape[:3], np.bool_)
    held = _Held(background)
    for frame, silhouette in zip(frames, silhouettes, strict=True):
        image = smooth(frame, held.planes)
        seed = _seed(image, background, held, settings)
        box = _box(seed, 2 * settings.reach_px)
        if box is None:
            continue
        least = settings.component_share * seed.size, settings.hole_share * seed.size
        region = seed[box].copy()
        if settings.rule == "chroma":
            region = _outlined(region, (box[0].start, box[1].start), held, least, settings)
        cleaned = np.empty(region.shape, np.bool_)
        clean_region(region, least, cleaned)
        silhouette[box] = cleaned
    return silhouettes


class _Held:
    """Arrays of the size of a picture, made once: the system takes its time to hand them out."""

    def __init__(self, background: Background) -> None:
        size = background.color.shape[:2]
        self.behind = np.empty((4, *size), np.float32)
        self.behind[:3] = background.color.transpose(2, 0, 1)
        self.behind[3] = self.behind[0] + self.behind[1] + self.behind[2]
        self.planes = np.empty((3, *size), np.uint8)
        self.seed = np.empty(size, np.uint8)


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
    image: NDArray[np.uint8], background: Background, held: _Held, settings: SilhouetteSettings
) -> NDArray[np.uint8]:
    """Return the pixels that may show the performer: 1, the others 0."""
    if settings.rule == "crcb":
        threshold = np.float32(settings.crcb_threshold)
        _differ_in_chroma(image, background.color, threshold, held.seed)
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
    _differ_in_color(held.planes, held.behind, background.noise, limits, held.seed)
    return held.seed


def _outlined(
    seed: NDArray[np.uint8],
    corner: tuple[int, int],
    held: _Held,
    least: tuple[float, float],
    settings: SilhouetteSettings,
) -> NDArray[np.uint8]:
    """Return the seed, which begins at a corner, with its outline where the colors meet."""
    found = np.empty(seed.shape, np.bool_)
    clean_region(seed, least, found)
    inside = found.view(np.uint8)
    rule = settings.reach_px, settings.cut, settings.other_color
    for _ in range(settings.passes):
        inside = draw_outline(inside, held.planes, held.behind, corner, rule)
    return inside


def _box(seed: NDArray[np.uint8], margin: int) -> tuple[slice, slice] | None:
    """Return the rows and columns of what is set, with a margin; None where nothing is."""
    column, row, columns, rows = cv2.boundingRect(seed)
    if not rows:
        return None
    return (
        slice(max(row - margin, 0), row + rows + margin),
        slice(max(column - margin, 0), column + columns + margin),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _differ_in_color(image: Any, behind: Any, noise: Any, limits: Any, seed: Any) -> None:
    """Set the pixels whose color no brightness of the background between the limits explains.

    Planes of a channel each, and loops without branches, so that they are vectorized.
    """
    gain, threshold, levels, darkest, brightest = limits
    columns = seed.shape[1]
    far, limit = np.empty(columns, np.float32), np.empty(columns, np.float32)
    for i in range(seed.shape[0]):
        red, green, blue = image[0, i], image[1, i], image[2, i]
        red_behind, green_behind, blue_behind = behind[0, i], behind[1, i], behind[2, i]
        for j in range(columns):
            r, g, b = np.float32(red[j]), np.float32(green[j]), np.float32(blue[j])
            br, bg, bb = gain * red_behind[j], gain * green_behind[j], gain * blue_behind[j]
            length = br * br + bg * bg + bb * bb + _BLACK
            share = (r * br + g * bg + b * bb) / length
            share = share if share > darkest else darkest
            share = share if share < brightest else brightest
            r, g, b = r - share * br, g - share * bg, b - share * bb
            far[j] = r * r + g * g + b * b
        for j in range(columns):
            least = levels * noise[i, j]
            least = least if least > threshold else threshold
            limit[j] = least * least
        for j in range(columns):
            seed[i, j] = far[j] > limit[j]


@njit(cache=True, nogil=True, error_model="numpy")
def _differ_in_chroma(image, color, threshold, seed):
    """Set the pixels whose Cr or Cb (ITU-R BT.601) is farther than `threshold` from the color's."""
    for i in range(image.shape[0]):
        for j in range(image.shape[1]):
            r = np.float32(image[i, j, 0]) - color[i, j, 0]
            g = np.float32(image[i, j, 1]) - color[i, j, 1]
            b = np.float32(image[i, j, 2]) - color[i, j, 2]
            y = _LUMA_OF_RED * r + _LUMA_OF_GREEN * g + _LUMA_OF_BLUE * b
            cr, cb = _CR_OF_RED * (r - y), _CB_OF_BLUE * (b - y)
            seed[i, j] = max(abs(cr), abs(cb)) > threshold


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
    backgrounds = _backgrounds(source, settings)
    rows, columns = largest_image(source.cameras)
    packed = np.zeros((end - start, len(source.cameras), rows, -(-columns // 8)), np.uint8)
    compared = [n for n in compared_frames(source.frames) if start <= n < end]
    stale = np.zeros((len(compared), *packed.shape[1:]), np.uint8)
    facts = np.zeros((len(compared), len(source.cameras), MASK_FACTS))
    filled = np.zeros((end - start, len(source.cameras)), np.int64)
    projection, grid = projection_of(source.cameras), grid_of(source)
    color: list[NDArray[np.uint8]] = []
    for first, films, masks in read_films_and_masks(source, start, end):
        found = np.zeros((len(films[0]), len(films), rows, columns), np.bool_)

        def extract(camera: int, first: int = first, films: Any = films, masks: Any = masks,
                    found: Any = found) -> None:  # fmt: skip
            film = films[camera]
            here = [(n, m - first) for n, m in enumerate(compared) if 0 <= m - first < len(film)]
            own = found[:, camera, : film.shape[1], : film.shape[2]]
            if masks:
                own[:] = silhouettes_of(masks[camera])
                for n, frame in here:
                    facts[n, camera] = mask_facts(masks[camera][frame])
                for each, mask, silhouette in zip(film, masks[camera], own, strict=True):
                    color_rim(each, mask, silhouette)
            else:
                own[:] = extract_silhouettes(film, backgrounds[camera], settings)
                for n, frame in here:
                    seen = own[frame], film[frame], backgrounds[camera].color
                    _put(stale[n, camera], np.packbits(stale_outline(*seen), axis=-1))

        def finish(frame: int, first: int = first, films: Any = films, found: Any = found) -> Any:
            if settings.holes == "fill" and not source.masks:  # those are taken as they are
                filled[first - start + frame] = fill_holes(found[frame], projection, grid)
            bits = packed[first - start + frame]
            bits[:] = np.packbits(found[frame], axis=-1)
            return [take_pixels(each, film[frame]) for each, film in zip(bits, films, strict=True)]

        ends = (first - start, first - start + len(films[0]))
        with within(ends[0] / (end - start), ends[1] / (end - start)):
            side_by_side(extract, range(len(films)))
            for of_cameras in side_by_side(finish, range(len(films[0]))):
                color += of_cameras
    arrays = {
        "silhouette": packed,
        "color": np.concatenate(color),
        "stale": stale,
        "masks": facts,
        "filled": filled,
        "sure": np.array([background.sure for background in backgrounds]),
    }
    return write_block(open_archive(archive).place, into, (start, end), arrays, begun)


def _backgrounds(source: Capture, settings: SilhouetteSettings) -> list[Background]:
    """Return the background of each camera; none where masks say where the performer is."""
    if source.masks:
        return []
    return read_backgrounds(source, settings.background, settings.key)


def _put(into: NDArray[np.uint8], bits: NDArray[np.uint8]) -> None:
    """Write packed pictures (..., row, column / 8) where there may be room for larger ones."""
    into[..., : bits.shape[-2], : bits.shape[-1]] = bits
