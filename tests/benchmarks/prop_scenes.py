"""Captures of known truth in which not all is the dancer: chairs, things held, a print, a second.

Each is a dance of `pose_captures` that is filmed with something more. Beside the truth of the
dancer stand the points of what is not the dancer, `<capture>_things.npz`: `things` (time, point, 3)
and `body` (time, point, 3), clothes included, m.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from storage.schema import JOINTS
from tasks.studio.cameras import generate_cameras
from tasks.studio.dancing.limbs import unit
from tasks.studio.filming import FilmSettings, film_capture
from tasks.studio.stage.bodies import BodySurface, Clothes, pose_surface
from tasks.studio.stage.scenes import Spoilers
from tasks.studio.stage.tubes import Color, Track, Tube, close_tube, join_tubes, tube_along
from tests.benchmarks.pose_captures import PLANS, dance_of

Floats = NDArray[np.float64]

WOOD: tuple[Color, Color] = ((120, 70, 30), (150, 96, 52))
STEEL: tuple[Color, Color] = ((150, 156, 170), (190, 196, 208))
PAPER: tuple[Color, Color] = ((206, 40, 50), (236, 196, 60))
BACKDROP = (62, 140, 76)
"""The color of the green stage [RGB]."""

ROOM_M = 0.45
"""How far from the middle of a chair all joints stay."""

FRAMES = 110
PASSES_M = 0.4
"""How far before the dancer another one goes by."""
PRINT_M = (0.065, 0.085)
"""Half the width and half the height of the print on the chest."""


def box(low: Sequence[float] | Floats, high: Sequence[float] | Floats, frames: int) -> Tube:
    """Return an upright box that stands still."""
    x, y, z = zip(low, high, strict=True)
    ring = np.array([[x[1], z[1]], [x[0], z[1]], [x[0], z[0]], [x[1], z[0]]])[::-1]
    grid = np.empty((frames, 2, 4, 3))
    for station in range(2):
        grid[:, station, :, 0], grid[:, station, :, 2] = ring.T
        grid[:, station, :, 1] = y[station]
    return close_tube(grid, np.ones((2, 4), int), WOOD)


def chair(joints: dict[str, Track]) -> list[Tube]:
    """Return a chair as near to the dancer as the dance leaves room for it."""
    all_joints = np.stack(list(joints.values()), axis=1)[..., [0, 2]].reshape(-1, 2)
    middle = (joints["RHip"] + joints["LHip"])[:, [0, 2]].mean(axis=0) / 2
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    places = [
        middle + far * np.array([np.cos(a), np.sin(a)])
        for far in np.arange(0.4, 2.5, 0.05)
        for a in angle
    ]
    room = (np.linalg.norm(all_joints - place, axis=1).min() for place in places)
    x, z = next(place for place, free in zip(places, room, strict=True) if free > ROOM_M)
    parts = [((-0.22, 0.42, -0.22), (0.22, 0.47, 0.22)), ((-0.22, 0.47, -0.22), (0.22, 0.9, -0.17))]
    parts += [
        ((a - 0.025, 0.0, b - 0.025), (a + 0.025, 0.44, b + 0.025))
        for a in (-0.19, 0.19)
        for b in (-0.19, 0.19)
    ]
    frames = len(joints["RHip"])
    place = np.array([x, 0.0, z])
    return [box(place + low, place + high, frames) for low, high in parts]


def hand_axes(joints: dict[str, Track], side: str = "R") -> tuple[Track, Track, Track, Track]:
    """Return the grip (time, 3) of a hand, its direction, and two more that turn with it."""
    wrist, tip = joints[f"{side}Wrist"], joints[f"{side}Fin"]
    along = unit(tip - wrist)
    up = np.empty_like(along)
    last = np.array([0.0, 1.0, 0.0])
    for t, axis in enumerate(along):
        last = unit(last - (last @ axis) * axis)
        up[t] = last
    return wrist + 0.55 * (tip - wrist), along, up, np.cross(along, up)


def sword(joints: dict[str, Track], side: str = "R") -> list[Tube]:
    """Return a sword of 75 cm that stands off the hand."""
    grip, along, up, aside = hand_axes(joints, side)
    way = unit(0.45 * along + up)
    stations = np.array([[s, 0.0, 0.02, 0.014] for s in np.linspace(0.0, 1.0, 12)])
    return [tube_along(grip - 0.12 * way, grip + 0.75 * way, aside, stations, 1, STEEL, around=10)]


def fan(joints: dict[str, Track], side: str = "R") -> list[Tube]:
    """Return an open fan, half a disc with a radius of 30 cm."""
    grip, along, up, aside = hand_axes(joints, side)
    angle = np.linspace(-0.45 * np.pi, 0.45 * np.pi, 15)
    near, far = 0.03, 0.30
    ring = []
    for radius, side_m in ((near, 0.008), (far, 0.008), (far, -0.008), (near, -0.008)):
        way = np.cos(angle)[:, None, None] * along + np.sin(angle)[:, None, None] * up
        ring.append(grip + radius * way + side_m * aside)
    grid = np.stack(ring, axis=1).transpose(2, 0, 1, 3)  # (time, station, around, 3)
    return [close_tube(grid, np.ones(grid.shape[1:3], int), PAPER)]


def umbrella(joints: dict[str, Track], side: str = "R") -> list[Tube]:
    """Return an open umbrella that is carried over the hand."""
    grip, _, _, aside = hand_axes(joints, side)
    up = np.broadcast_to(unit(np.array([0.15, 1.0, 0.1])), grip.shape)
    front = unit(aside - (aside * up).sum(1, keepdims=True) * up)
    rod = np.array([[s, 0.0, 0.013, 0.013] for s in np.linspace(0.0, 1.0, 8)])
    dome = np.array(
        [
            [0.0, 0.0, 0.44, 0.44],
            [0.35, 0.0, 0.34, 0.34],
            [0.75, 0.0, 0.18, 0.18],
            [1, 0, 0.02, 0.02],
        ]
    )
    top = grip + 0.62 * up
    return [
        tube_along(grip - 0.1 * up, top, front, rod, 1, WOOD, around=8),
        tube_along(top - 0.16 * up, top, front, dome, 1, PAPER, around=20),
    ]


@dataclass(frozen=True)
class Scene:
    """A dance and what is not the dancer in it."""

    plan: str = "indian-fitting"
    things: Callable[[dict[str, Track]], list[Tube]] | None = None
    clothes: Clothes = "fitting"
    printed: bool = False
    shadow: float = Spoilers().shadow
    size: tuple[int, int] = (320, 240)
    samples: int = 3


def second(joints: dict[str, Track]) -> list[Tube]:
    """Return another dancer, 1.6 m aside and a second late."""
    return [_tube_of({name: _late(track) + 1.6 * _left(joints) for name, track in joints.items()})]


def crossing(joints: dict[str, Track]) -> list[Tube]:
    """Return another dancer, who goes by closely: 1.5 m aside first, at last on the other side."""
    left = _left(joints)
    front = np.cross(left, (0.0, 1.0, 0.0))
    share = np.linspace(1.5, -1.5, len(joints["LHip"]))[:, None]
    moved = share * left + PASSES_M * front
    return [_tube_of({name: _late(track) + moved for name, track in joints.items()})]


def _left(joints: dict[str, Track]) -> Floats:
    """Return the level direction to the dancer's left at the beginning."""
    return unit((joints["LHip"] - joints["RHip"])[0] * [1.0, 0.0, 1.0])


def _late(track: Track) -> Track:
    """Return a track a second late; it stays in its beginning until then."""
    return np.concatenate([np.repeat(track[:1], 30, axis=0), track[:-30]])


def _tube_of(joints: dict[str, Track]) -> Tube:
    """Return the surface of a body as a thing."""
    body = pose_surface(joints)
    return Tube(body.vertex.astype(np.float64), body.triangle, body.color, body.segment)


SCENES = {
    "none": Scene(),
    "chair": Scene(things=chair),
    "sword": Scene(things=sword),
    "fan": Scene(things=fan, clothes="kimono"),
    "umbrella": Scene(things=umbrella),
    "print": Scene(printed=True),
    "second": Scene(things=second),
    "crossing": Scene(things=crossing),
    "shadow": Scene(shadow=0.75),
    "large": Scene(size=(1920, 1080), samples=1),
}
"""By name."""


def dressed(scene: Scene, joints: dict[str, Track]) -> Callable[[BodySurface], BodySurface]:
    """Return what adds the things of a scene, and its print, to a performer's surface."""

    def dress(body: BodySurface) -> BodySurface:
        if scene.printed:
            body = replace(body, color=printed(body, joints))
        if scene.things is None:
            return body
        own = Tube(body.vertex.astype(np.float64), body.triangle, body.color, body.segment)
        whole = join_tubes([own, *scene.things(joints)])
        more = np.ones(whole.vertex.shape[1] - body.vertex.shape[1], np.bool_)
        return BodySurface(
            whole.vertex.astype(np.float32), whole.triangle, whole.color, whole.segment,
            np.concatenate([body.is_cloth, more]),
        )  # fmt: skip

    return dress


def printed(body: BodySurface, joints: dict[str, Track]) -> NDArray[np.uint8]:
    """Return the colors of a shirt with a print of the color of the stage on its chest."""
    center = body.vertex[0, body.triangle].mean(axis=1)
    up = unit((joints["Neck"] - joints["Waist"])[0])
    left = unit((joints["LShoulder"] - joints["RShoulder"])[0])
    front = np.cross(left, up)
    middle = (joints["Neck"] + joints["Waist"])[0] / 2
    away = center - middle
    is_print = (abs(away @ left) < PRINT_M[0]) & (abs(away @ up) < PRINT_M[1])
    is_print &= (away @ front > 0.03) & np.isin(body.segment[body.triangle[:, 0]], (2, 3))
    color = body.color.copy()
    color[is_print] = BACKDROP
    return color


def make_scene(folder: Path, data: Path, name: str, frames: int = FRAMES) -> Path:
    """Film a scene where it is not there yet; return its folder."""
    scene, into = SCENES[name], folder / name
    things = folder / f"{name}_things.npz"
    if things.exists():
        return into
    plan = PLANS[scene.plan]
    position = dance_of(plan, data, frames)
    joints = dict(zip(JOINTS, np.moveaxis(position, 1, 0), strict=True))
    center = position.reshape(-1, 3)
    middle = (center.min(axis=0) + center.max(axis=0)) / 2.0
    reach = np.ptp(center[:, [0, 2]], axis=0).max() / 2.0
    ring = replace(plan.ring, radius_m=max(plan.ring.radius_m, 3.2 + reach), size=scene.size)
    dress = dressed(scene, joints)
    film_capture(
        into, position, plan.rate_hz,
        cameras=generate_cameras(ring, center_m=middle, seed=0),
        settings=FilmSettings(
            clothes=scene.clothes, samples=scene.samples, spoilers=Spoilers(shadow=scene.shadow)
        ),
        metadata={"title": name, "performer": "generated"}, seed=0, dress=dress,
    )  # fmt: skip
    body = pose_surface(joints, clothes=scene.clothes)
    whole = dress(body)
    own = body.vertex.shape[1]
    np.savez_compressed(
        things,
        body=_dense(whole.vertex[:, :own], body.triangle),
        things=_dense(whole.vertex[:, own:], whole.triangle[len(body.triangle) :] - own),
    )
    return into


def _dense(vertex: NDArray[np.float32], triangle: NDArray[np.int32]) -> NDArray[np.float16]:
    """Return (time, point, 3) points of a surface, none farther than 1.5 cm from others."""
    if not len(triangle):
        return np.zeros((len(vertex), 0, 3), np.float16)
    corner = vertex[0, triangle]
    long = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    points = []
    for n in range(1, 65):
        own = triangle[np.ceil(long / 0.015).clip(1, 64) == n]
        if not len(own):
            continue
        a, b = (x.ravel() for x in np.meshgrid(*[(np.arange(n) + 0.5) / n] * 2))
        keep = a + b < 1.0 + 1e-9
        share = np.stack([1.0 - a - b, a, b])[:, keep]
        points.append(np.einsum("tfcx,cp->tfpx", vertex[:, own], share).reshape(len(vertex), -1, 3))
    return np.concatenate(points, axis=1).astype(np.float16)
