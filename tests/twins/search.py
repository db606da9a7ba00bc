"""Slow twins, written from the papers and from docs/contract.md, importing nothing of ours.

Loops and float64; positions are arrays (time, joint, 3), frames and samples count from 0.
"""

import math

import numpy as np

INDEX_RATE_HZ = 30.0
SIDE = ("Shoulder", "Elbow", "Wrist", "Fin", "Hip", "Knee", "Ankle", "Heel", "Foot")
JOINTS = ("Head", "Neck", "Waist", *("R" + n for n in SIDE), *("L" + n for n in SIDE))
ABOUT_SHOULDERS = {"Head", "Neck"} | {s + n for s in "RL" for n in SIDE[:4]}


def stature(position, joints):
    """Return the median over frames of head to hips plus mean of the legs (docs/contract.md)."""
    found = []
    for frame in position:
        p = dict(zip(joints, frame, strict=True))
        legs = []
        for side in "RL":
            leg = math.dist(p[side + "Hip"], p[side + "Knee"])
            leg += math.dist(p[side + "Knee"], p[side + "Ankle"])
            if not math.isnan(leg):
                legs.append(leg)
        hips = [(a + b) / 2 for a, b in zip(p["RHip"], p["LHip"], strict=True)]
        rest = math.dist(p["Head"], p["Neck"]) + math.dist(p["Neck"], hips)
        if legs and not math.isnan(rest):
            found.append(rest + sum(legs) / len(legs))
    return float(np.median(found)) if found else math.nan


def resample(position, rate_hz):
    """Return positions at the first time + n / 30 Hz, linear between two frames."""
    samples = []
    n = 0
    while n * rate_hz / INDEX_RATE_HZ <= len(position) - 1 + 1e-6:
        at = n * rate_hz / INDEX_RATE_HZ
        before = round(at) if abs(at - round(at)) < 1e-6 else math.floor(at)
        share = at - before
        if abs(share) < 1e-6:
            samples.append(np.array(position[before], float))
        else:
            samples.append((1 - share) * position[before] + share * position[before + 1])
        n += 1
    return np.array(samples)


def normalize(pose, stature_m, origin="Hip"):
    """Return a pose moved, turned about Y with a rotation matrix, and scaled (paper, 3.3)."""
    p = {name: np.array(pose[k], float) for k, name in enumerate(JOINTS)}
    across = p["LHip"] - p["RHip"]
    if not math.hypot(across[0], across[2]) > 1e-3 * stature_m:
        return np.full((len(JOINTS), 3), np.nan)
    angle = -math.atan2(across[0], across[2])
    turn = np.array(
        [
            [math.cos(angle), 0, math.sin(angle)],
            [0, 1, 0],
            [-math.sin(angle), 0, math.cos(angle)],
        ]
    )
    middle = (p["R" + origin] + p["L" + origin]) / 2
    hips = (p["RHip"] + p["LHip"]) / 2
    return np.array([turn @ (p[name] - middle + 0 * hips) / stature_m for name in JOINTS])


def path(samples, stature_m, lever):
    """Return forward, left and turning velocity of each sample, over 3 samples each way."""
    n = len(samples)
    out = np.full((n, 3), np.nan)
    right, left = (np.array(samples)[:, JOINTS.index(s + "Hip")] for s in "RL")
    heading = [math.atan2(*(b - a)[[0, 2]]) for a, b in zip(right, left, strict=True)]
    for k in range(n):
        a, b = max(0, k - 3), min(n - 1, k + 3)
        seconds = (b - a) / INDEX_RATE_HZ
        if seconds == 0:
            out[k] = 0
            continue
        moved = ((right[b] + left[b]) - (right[a] + left[a])) / 2 / stature_m / seconds
        to_left = np.array([math.sin(heading[k]), 0, math.cos(heading[k])])
        forward = np.cross(to_left, [0, 1, 0])
        turned = heading[b] - heading[a]
        turned -= 2 * math.pi * round(turned / (2 * math.pi)) if math.isfinite(turned) else 0
        out[k] = moved @ forward, moved @ to_left, turned / seconds * lever
    return out


def pose_distance(p, q, weights):
    """Return the weighted mean over joints of |p_k - q_k| (paper, 3.2; docs/contract.md)."""
    total = 0.0
    for k, weight in enumerate(weights):
        if weight > 0:
            total += weight * math.sqrt(sum((a - b) ** 2 for a, b in zip(p[k], q[k], strict=True)))
    return total / sum(weights)


def distances(query, take, weights):
    """Return d (i, j); infinite where a joint that counts is missing."""
    d = np.array([[pose_distance(p, q, weights) for q in take] for p in query])
    return np.where(np.isnan(d), math.inf, d)


def warp_slope(d):
    """Return g(I, j) and G(I, j) of the symmetric steps with P = 1; the first of equals wins."""
    rows, columns = d.shape
    g = np.full(d.shape, math.inf)
    start = np.full(d.shape, -1)
    for i in range(rows):
        for j in range(columns):
            if i == 0:
                g[i, j], start[i, j] = d[i, j], j
                continue
            steps = []
            if j >= 1:
                steps.append((g[i - 1, j - 1] + 2 * d[i, j], start[i - 1, j - 1]))
            if j >= 2:
                cost = g[i - 1, j - 2] + 2 * d[i, j - 1] + d[i, j]
                steps.append((cost, start[i - 1, j - 2]))
            if i >= 2 and j >= 1:
                cost = g[i - 2, j - 1] + 2 * d[i - 1, j] + d[i, j]
                steps.append((cost, start[i - 2, j - 1]))
            if steps:
                g[i, j], start[i, j] = min(steps, key=lambda step: step[0])
    return g[-1], start[-1]


def warp_paper(d):
    """Return g(I, j) and G(I, j) of equations (1) and (2); the first of equals wins."""
    rows, columns = d.shape
    g = np.full(d.shape, math.inf)
    start = np.full(d.shape, -1)
    for i in range(rows):
        for j in range(columns):
            if i == 0:
                g[i, j], start[i, j] = d[i, j], j
                continue
            steps = [(g[i - 1, j] + d[i, j], start[i - 1, j])]
            if j >= 1:
                steps.append((g[i - 1, j - 1] + 2 * d[i, j], start[i - 1, j - 1]))
                steps.append((g[i, j - 1] + d[i, j], start[i, j - 1]))
            g[i, j], start[i, j] = min(steps, key=lambda step: step[0])
    return g[-1], start[-1]


def ends(d, steps):
    """Return the distance and the start of the match that ends at each j."""
    g, start = warp_slope(d) if steps == "slope" else warp_paper(d)
    length = np.arange(len(g)) - start + 1
    return g / (len(d) + length - 1), start


def nearest_frame(sample, rate_hz):
    """Return the frame nearest in time to a sample, the later of two."""
    return math.floor(sample * rate_hz / INDEX_RATE_HZ + 0.5)


def select(distance, start, rate_hz, threshold=math.inf, top=10):
    """Return (version, start, end, distance), greedily, no two sharing a frame of the take."""
    versions, samples = distance.shape
    version, end = (axis.ravel() for axis in np.indices((versions, samples)))
    order = np.lexsort((version, end, start.ravel(), distance.ravel()))
    taken, found = set(), []
    for k in order:
        first, value = int(start.ravel()[k]), distance.ravel()[k]
        if len(found) == top or not value < threshold:
            break
        low, high = nearest_frame(first, rate_hz), nearest_frame(end[k], rate_hz)
        frames = set(range(low, high + 1))
        if not frames & taken:
            taken |= frames
            found.append((int(version[k]), first, int(end[k]), float(value)))
    return found


def mirror(position):
    """Return the motion seen in a mirror: z turned round, right and left exchanged."""
    other = [{"R": "L", "L": "R"}.get(n[0], n[0]) + n[1:] for n in JOINTS]
    swapped = position[:, [JOINTS.index(name) for name in other]]
    return swapped * np.array([1.0, 1.0, -1.0])


def search(query, clip, take, weights, *, steps="slope", path_weight=0.0, top=10, lever=0.25):
    """Return (start, end, distance) of a clip of one motion in another, both (position, rate).

    clip : first and last sample of the query; weights : a dict by joint.
    """
    origin = "Shoulder" if set(weights) <= ABOUT_SHOULDERS else "Hip"
    sides = []
    for position, rate_hz in (query, take):
        stature_m = stature(position, JOINTS)
        samples = resample(position, rate_hz)
        poses = np.array([normalize(pose, stature_m, origin) for pose in samples])
        present = 2 * np.isfinite(position).all(axis=2).sum(axis=0) >= len(position)
        sides.append((poses, path(samples, stature_m, lever), present))
    (p, p_path, has_p), (q, q_path, has_q) = sides
    used = [weights.get(n, 0.0) * has_p[k] * has_q[k] for k, n in enumerate(JOINTS)]
    p, p_path = p[clip[0] : clip[1] + 1], p_path[clip[0] : clip[1] + 1]
    d = distances(p, q, used)
    if path_weight > 0:
        for i in range(len(p)):
            for j in range(len(q)):
                d[i, j] += path_weight * math.dist(p_path[i], q_path[j])
        d[np.isnan(d)] = math.inf
    distance, start = ends(d, steps)
    rate_hz = take[1]
    return [
        (nearest_frame(a, rate_hz), min(nearest_frame(b, rate_hz), len(take[0]) - 1), value)
        for _, a, b, value in select(distance[None], start[None], rate_hz, top=top)
    ]
