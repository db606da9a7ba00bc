// Where the joints of query and match are drawn: the geometry of the retrieval paper's overlays.
export let BONES = [], OTHER_SIDE = [], J = {};
let joints = 0;

// Say which joints there are; `bones` are pairs of names.
export function setBody(names, bones, otherSide) {
  J = Object.fromEntries(names.map((name, k) => [name, k]));
  BONES = bones.map(([a, b]) => [J[a], J[b]]);
  OTHER_SIDE = otherSide;
  joints = names.length;
}

// The lines of a pose; where the waist is missing, the neck is joined to the hips.
export function linesOf(pose) {
  return Number.isFinite(pose[3 * J.Waist]) ? BONES : [...BONES, [J.Neck, J.RHip], [J.Neck, J.LHip]];
}

// The pose between two frames; null while they are not loaded.
export function poseAt(track, at) {
  const before = Math.floor(at), share = at - before, a = track.frame(before);
  if (!a || share < 1e-6) return a;
  const b = track.frame(before + 1);
  if (!b) return a;
  const pose = new Float32Array(a.length);
  for (let i = 0; i < a.length; i++) pose[i] = a[i] + share * (b[i] - a[i]);
  return pose;
}

// The middle of the hips, and the angle about Y by which the body is turned from facing +Z.
export function hipsOf(pose) {
  const r = 3 * J.RHip, l = 3 * J.LHip;
  const x = (pose[r] + pose[l]) / 2, y = (pose[r + 1] + pose[l + 1]) / 2, z = (pose[r + 2] + pose[l + 2]) / 2;
  const across = [pose[l] - pose[r], pose[l + 2] - pose[r + 2]];
  return { x, y, z, turn: Math.atan2(-across[1], across[0]) }; // the left hip at +X where it faces +Z
}

// As `hipsOf`, but about the middle of the shoulders, from where arms and head are compared.
function shouldersOf(pose) {
  const r = 3 * J.RShoulder, l = 3 * J.LShoulder;
  return { x: (pose[r] + pose[l]) / 2, y: (pose[r + 1] + pose[l + 1]) / 2, z: (pose[r + 2] + pose[l + 2]) / 2, turn: hipsOf(pose).turn };
}

// Turn a pose about the middle of `from` until it faces as `to` does, scale it, and put it there.
function carried(pose, from, to, { scale = 1, mirrored = false, height = true } = {}) {
  const out = new Float32Array(pose.length), c = Math.cos(-from.turn), s = Math.sin(-from.turn);
  const C = Math.cos(to.turn), S = Math.sin(to.turn);
  for (let k = 0; k < joints; k++) {
    const i = 3 * (mirrored ? OTHER_SIDE[k] : k);
    const dx = pose[i] - from.x, dz = pose[i + 2] - from.z;
    const x = scale * (c * dx + s * dz) * (mirrored ? -1 : 1), z = scale * (c * dz - s * dx);
    out[3 * k] = to.x + C * x + S * z;
    out[3 * k + 1] = height ? to.y + scale * (pose[i + 1] - from.y) : scale * pose[i + 1];
    out[3 * k + 2] = to.z + C * z - S * x;
  }
  return out;
}

// A pose turned to face the viewer, a little aside, its hips over the origin.
export function facing(pose) {
  const hips = hipsOf(pose);
  return Number.isFinite(hips.x + hips.turn) ? carried(pose, { ...hips, y: 0 }, { ...STAND, turn: 0.5 }, { height: false }) : pose;
}

// Seconds of the match at which it does what the query does at `t` seconds.
export function matchSeconds(match, t) {
  const path = match.path;
  if (!path || !path.length) return t;
  if (t <= path[0][0]) return path[0][1];
  for (let n = 1; n < path.length; n++)
    if (t <= path[n][0]) {
      const [a, b] = path[n - 1], [c, d] = path[n];
      return c > a ? b + ((t - a) / (c - a)) * (d - b) : d;
    }
  return path[path.length - 1][1];
}

const STAND = { x: 0, y: 0, z: 0, turn: 0 };
export const APART = 0.75; // metres to the side of the middle, of two figures side by side

// The poses to draw at `t` seconds: [{who, pose, frame, base, color}], pose null while it loads.
export function compose(score, tracks, t, show) {
  const figures = [], { query, match } = score;
  const both = match && show.mode !== "query", aside = both && show.mode === "side" ? APART : 0;
  const qFrame = Math.min(query.end, query.start + t * query.rate);
  const base = baseOf(tracks.query, query.start, query.end), raw = poseAt(tracks.query, qFrame);
  const stand = { ...STAND, x: -aside };
  const pose = raw && base && carried(raw, base, stand, { height: false });
  figures.push({ who: "query", pose, frame: qFrame, base, stand });
  if (!both) return figures;
  const seconds = show.realTime ? t : matchSeconds(match, t);
  const mFrame = Math.min(match.end, match.start + seconds * match.rate);
  const mRaw = poseAt(tracks.match, mFrame), mBase = baseOf(tracks.match, match.start, match.end);
  const options = { mirrored: match.mirrored, scale: query.stature / match.stature };
  const mStand = { ...STAND, x: aside };
  let mPose = null;
  if (mRaw && mBase && pose) {
    const about = score.about === "shoulders" ? shouldersOf : hipsOf, hips = about(mRaw), to = about(pose);
    const pinned = show.mode === "overlay" && show.pinned && Number.isFinite(hips.x + to.x + hips.turn + to.turn);
    mPose = pinned ? carried(mRaw, hips, to, options) : carried(mRaw, mBase, mStand, { ...options, height: false });
  }
  figures.push({ who: "match", pose: mPose, frame: mFrame, base: mBase, stand: mStand });
  return figures;
}

// Where a clip begins: the first frame whose hips are known, on the floor.
function baseOf(track, start, end) {
  const key = `${start}-${end}`;
  track.bases ||= new Map();
  if (track.bases.has(key)) return track.bases.get(key);
  for (let frame = start; frame <= end; frame++) {
    const pose = track.frame(frame);
    if (!pose) return null;
    const hips = hipsOf(pose);
    if (Number.isFinite(hips.x + hips.turn)) {
      track.bases.set(key, { ...hips, y: 0 });
      return track.bases.get(key);
    }
  }
  const nothing = { ...STAND };
  track.bases.set(key, nothing);
  return nothing;
}

// The ball of a head: middle and radius, or null.
export function headOf(pose) {
  const h = 3 * J.Head, n = 3 * J.Neck, d = [0, 1, 2].map((k) => pose[n + k] - pose[h + k]);
  const long = Math.hypot(...d);
  if (!Number.isFinite(long)) return null;
  return { middle: d.map((v, k) => pose[h + k] + 0.42 * v), radius: 0.36 * long };
}
