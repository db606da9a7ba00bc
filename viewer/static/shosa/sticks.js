// Stick figures on a flat canvas: thumbnails, the report, and browsers without WebGL.
import { J, facing, headOf, linesOf } from "./figures.js";

// Draw poses seen from `view` {azimuth, elevation, middle, height}: figures [{pose, color, strong}].
export class StickCanvas {
  constructor(canvas) { this.canvas = canvas; this.view = { azimuth: 0.5, elevation: 0.14, x: 0, z: 0, height: 2.2 }; }

  project(p, i = 0) {
    const { azimuth, elevation, x, z, height } = this.view, h = this.canvas.height;
    const dx = p[i] - x, dz = p[i + 2] - z, scale = h / height;
    const right = Math.cos(azimuth) * dx - Math.sin(azimuth) * dz, toward = Math.sin(azimuth) * dx + Math.cos(azimuth) * dz;
    const up = Math.cos(elevation) * p[i + 1] - Math.sin(elevation) * toward;
    return [this.canvas.width / 2 + scale * right, h * 0.9 - scale * up];
  }

  draw(figures, { background, grid, ratio = 1 }) {
    const c = this.canvas.getContext("2d");
    c.fillStyle = background; c.fillRect(0, 0, this.canvas.width, this.canvas.height);
    c.strokeStyle = grid; c.lineWidth = ratio; c.lineCap = "round";
    if (grid) {
      c.beginPath();
      for (let k = -4; k <= 4; k++)
        for (const [a, b] of [[[k / 2, 0, -2], [k / 2, 0, 2]], [[-2, 0, k / 2], [2, 0, k / 2]]]) {
          c.moveTo(...this.project(a)); c.lineTo(...this.project(b));
        }
      c.stroke();
    }
    for (const { pose, color, strong } of figures) {
      if (!pose) continue;
      for (const [a, b] of linesOf(pose)) {
        const line = [...this.project(pose, 3 * a), ...this.project(pose, 3 * b)];
        if (!line.every(Number.isFinite)) continue;
        c.globalAlpha = !strong || strong.has(a) || strong.has(b) ? 1 : 0.3;
        c.strokeStyle = color; c.lineWidth = 5 * ratio;
        c.beginPath(); c.moveTo(line[0], line[1]); c.lineTo(line[2], line[3]); c.stroke();
      }
      const head = headOf(pose);
      if (head) {
        const [x, y] = this.project(head.middle);
        c.globalAlpha = !strong || strong.has(J.Head) || strong.has(J.Neck) ? 1 : 0.3;
        c.fillStyle = color; c.beginPath(); c.arc(x, y, (head.radius * this.canvas.height) / this.view.height, 0, 7); c.fill();
      }
      c.globalAlpha = 1;
    }
  }

  // Let the pointer turn the view; `changed` is called after each turn.
  orbit(changed) {
    let from = null;
    this.canvas.addEventListener("pointerdown", (e) => { from = [e.clientX, e.clientY]; this.canvas.setPointerCapture(e.pointerId); });
    this.canvas.addEventListener("pointerup", () => { from = null; });
    this.canvas.addEventListener("pointermove", (e) => {
      if (!from) return;
      this.view.azimuth -= (e.clientX - from[0]) / 120;
      this.view.elevation = Math.max(-0.1, Math.min(1.5, this.view.elevation + (e.clientY - from[1]) / 200));
      from = [e.clientX, e.clientY];
      changed();
    });
    this.canvas.addEventListener("wheel", (e) => { e.preventDefault(); this.view.height *= Math.exp(e.deltaY / 800); changed(); }, { passive: false });
  }
}

// Draw a row of poses, each about the middle of its place: poses are of the joints in metres.
export function strip(canvas, found, color, ratio) {
  const poses = found.map(facing);
  const c = canvas.getContext("2d"), cell = canvas.width / Math.max(1, poses.length);
  c.clearRect(0, 0, canvas.width, canvas.height);
  c.strokeStyle = color; c.lineWidth = 1.5 * ratio; c.lineCap = "round";
  const heights = poses.flatMap((pose) => [...pose].filter((v, i) => i % 3 === 1 && Number.isFinite(v)));
  const scale = (canvas.height * 0.94) / Math.max(1.2, ...heights);
  poses.forEach((pose, n) => {
    const xs = [...pose].filter((v, i) => i % 3 === 0 && Number.isFinite(v));
    const middle = xs.length ? (Math.min(...xs) + Math.max(...xs)) / 2 : 0;
    c.beginPath();
    for (const [a, b] of linesOf(pose)) {
      const ends = [a, b].flatMap((k) => [cell * (n + 0.5) + scale * (pose[3 * k] - middle), canvas.height * 0.98 - scale * pose[3 * k + 1]]);
      if (ends.every(Number.isFinite)) { c.moveTo(ends[0], ends[1]); c.lineTo(ends[2], ends[3]); }
    }
    c.stroke();
  });
}
