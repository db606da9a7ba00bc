// Joint tracks and voxel frames: fetched in pieces ahead of the playhead, decoded, kept.
const TRACK_PIECE = 512; // frames
const VOXEL_PIECE = 15; // frames: half a second of most captures
const VOXELS_KEPT = 600; // frames
const LOST = -32768;

const held = new Map();
const kept = (key, make) => {
  if (!held.has(key)) held.set(key, make());
  return held.get(key);
};

async function bytes(url) {
  const answer = await fetch(url);
  if (!answer.ok) throw new Error((await answer.text()).trim() || `${answer.status}`);
  const content = await answer.arrayBuffer();
  window.shosa.bytes = (window.shosa.bytes || 0) + content.byteLength;
  return content;
}

const path = (kind, m) => `/data/${kind}/${encodeURIComponent(m.take)}/${encodeURIComponent(m.version)}`;

// Return {first, step, rows, joints, at(row)}: positions of the joints in metres, NaN where missing.
export function decodeTrack(content) {
  const view = new DataView(content);
  const joints = view.getUint16(6, true), rows = view.getUint32(8, true);
  const first = view.getUint32(12, true), step = view.getUint32(16, true), scale = view.getFloat32(20, true);
  const middle = [24, 28, 32].map((at) => view.getFloat32(at, true));
  const steps = new Int16Array(content, 36), place = new Float32Array(joints * 3 * rows);
  for (let k = 0; k < joints * 3; k++) {
    let sum = 0;
    for (let row = 0; row < rows; row++) {
      sum = ((sum + steps[k * rows + row]) << 16) >> 16; // wraps, as it was packed
      place[row * joints * 3 + k] = sum === LOST ? NaN : sum * scale + middle[k % 3];
    }
  }
  return { first, step, rows, joints, at: (row) => place.subarray(row * joints * 3, (row + 1) * joints * 3) };
}

// A motion's frames: `frame(n)` is null until its piece is there; `want` asks for pieces.
export function openTrack(motion) {
  return kept(path("track", motion), () => {
    const pieces = new Map(), waiting = new Map();
    const load = (number) => {
      if (pieces.has(number) || waiting.has(number)) return waiting.get(number);
      const start = number * TRACK_PIECE, end = Math.min(start + TRACK_PIECE, motion.frames) - 1;
      const coming = bytes(`${path("track", motion)}?start=${start}&end=${end}`)
        .then((content) => pieces.set(number, decodeTrack(content)))
        .finally(() => waiting.delete(number));
      waiting.set(number, coming);
      return coming;
    };
    return {
      frame(n) {
        const at = Math.max(0, Math.min(motion.frames - 1, n)), piece = pieces.get(Math.floor(at / TRACK_PIECE));
        return piece ? piece.at(at % TRACK_PIECE) : null;
      },
      want(first, last) {
        const coming = [], end = Math.min(last, motion.frames - 1);
        for (let n = Math.floor(Math.max(0, first) / TRACK_PIECE); n <= Math.floor(end / TRACK_PIECE); n++) coming.push(load(n));
        return Promise.all(coming).then((came) => came.some(Boolean)); // whether there is anything new
      },
    };
  });
}

// Some rows of a span of frames, evenly spaced, at most `most` of them.
export function overview(motion, start, end, most) {
  const step = Math.max(1, Math.ceil((end - start + 1) / most));
  const url = `${path("track", motion)}?start=${start}&end=${end}&step=${step}`;
  return kept(url, () => bytes(url).then(decodeTrack).catch((error) => { held.delete(url); throw error; }));
}

export function decodeVoxels(content) {
  const view = new DataView(content), colors = view.getUint16(6, true);
  const frames = view.getUint32(8, true), voxel_m = view.getFloat32(16, true);
  const origin = [20, 24, 28].map((at) => view.getFloat32(at, true));
  const [, ny, nz] = [36, 40, 44].map((at) => view.getUint32(at, true));
  const palette = new Uint8Array(content, 52, colors * 3), found = new Map();
  let at = 52 + colors * 3;
  for (let n = 0; n < frames; n++) {
    const [frame, count, wide] = [0, 4, 8].map((more) => view.getUint32(at + more, true));
    at += 16;
    const far = at, short = far + 4 * wide, place = new Float32Array(3 * count);
    let number = 0, next = 0;
    for (let i = 0; i < count; i++) {
      const ahead = view.getUint8(short + i);
      number += ahead === 255 ? view.getUint32(far + 4 * next++, true) : ahead;
      const z = number % nz, rest = (number - z) / nz, y = rest % ny;
      place[3 * i] = origin[0] + (voxel_m * (rest - y)) / ny;
      place[3 * i + 1] = origin[1] + voxel_m * y;
      place[3 * i + 2] = origin[2] + voxel_m * z;
    }
    const color = new Uint8Array(content, short + count, count), label = new Uint8Array(content, short + 2 * count, count);
    found.set(frame, { count, place, color, label, palette, voxel_m });
    at = short + 3 * count;
  }
  return found;
}

// A take's voxels: `frame(n)` is null until its piece is there; the longest unused are let go.
export function openVoxels(motion) {
  return kept(path("voxels", motion), () => {
    const frames = new Map(), waiting = new Map();
    return {
      frame: (n) => frames.get(n) || null,
      want(n) {
        const number = Math.floor(Math.max(0, Math.min(n, motion.frames - 1)) / VOXEL_PIECE), start = number * VOXEL_PIECE;
        if (frames.has(start)) return Promise.resolve();
        if (waiting.has(number)) return waiting.get(number);
        const coming = bytes(`${path("voxels", motion)}?start=${start}&count=${VOXEL_PIECE}`)
          .then((content) => {
            for (const [frame, voxels] of decodeVoxels(content)) frames.set(frame, voxels);
            for (const frame of frames.keys()) if (frames.size > VOXELS_KEPT) frames.delete(frame);
            return true;
          })
          .finally(() => waiting.delete(number));
        waiting.set(number, coming);
        return coming;
      },
    };
  });
}
