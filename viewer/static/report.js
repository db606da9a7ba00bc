import { compose, matchSeconds, setBody } from "./shosa/figures.js";
import { player } from "./shosa/player.js";
import { StickCanvas } from "./shosa/sticks.js";

const content = JSON.parse(document.getElementById("content").textContent), { texts, body } = content;
const at = (id) => document.getElementById(id), look = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
setBody(body.joints, body.bones, body.otherSide);

// Frames of a clip, between the rows that were written.
function opened(packed) {
  const raw = atob(packed.track), bytes = Uint8Array.from(raw, (letter) => letter.charCodeAt(0)), track = decodeTrack(bytes.buffer);
  return {
    track,
    frame(n) {
      const row = Math.max(0, Math.min(track.rows - 1, (n - track.first) / track.step)), before = Math.floor(row), share = row - before;
      const a = track.at(before), b = track.at(Math.min(track.rows - 1, before + 1));
      return share < 1e-6 ? a : a.map((v, i) => v + share * (b[i] - v));
    },
  };
}

const query = opened(content.query), matches = content.matches.map(opened), stage = new StickCanvas(at("stage"));
const show = { mode: "overlay", pinned: true, realTime: false };
let chosen = 0, joint = content.joint;

function button(row, n) {
  const made = document.createElement("button"), svg = document.createElementNS("http://www.w3.org/2000/svg", "svg"), path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  made.className = "result"; made.type = "button"; made.dataset.rank = row.rank;
  svg.setAttribute("viewBox", "0 0 96 40"); path.setAttribute("d", row.strip); svg.append(path);
  const texts_ = [String(row.rank), `${row.title}`, `${row.performer}${row.mirrored ? ` · ${texts.mirrored}` : ""} ${row.first}–${row.last} · ${row.seconds} s`, row.distance];
  const meant = [row.level && texts[`level_${row.level}`], row.chance].filter(Boolean);
  const [rank, what, far] = ["span", "span", "span"].map((name) => document.createElement(name)), small = document.createElement("small");
  rank.textContent = texts_[0]; what.textContent = texts_[1]; small.textContent = texts_[2]; far.textContent = texts_[3]; far.className = "far";
  for (const each of meant) far.append(Object.assign(document.createElement("small"), { textContent: each }));
  what.append(small); made.append(rank, svg, what, far);
  made.addEventListener("click", () => open(n));
  return made;
}

function open(n) {
  chosen = n;
  document.querySelectorAll(".result").forEach((each, k) => each.setAttribute("aria-pressed", String(k === n)));
  const q = content.scores[n].query;
  player.setLength((q.end - q.start) / q.rate, q.rate);
  player.playing = true;
}

function draw() {
  const score = content.scores[chosen], canvas = at("stage"), ratio = devicePixelRatio || 1;
  const w = Math.round(canvas.clientWidth * ratio), h = Math.round(canvas.clientHeight * ratio);
  if (canvas.width !== w || canvas.height !== h) { canvas.width = w; canvas.height = h; }
  const figures = compose(score, { query, match: matches[chosen] }, player.t, show);
  const strong = score.strong.length < body.joints.length ? new Set(score.strong) : null;
  stage.draw(figures.map((each) => ({ ...each, color: look(`--${each.who}`), strong })), { background: look("--stage"), grid: look("--grid"), ratio });
  window.shosaReport = { figures, chosen, playing: player.playing };
  at("time").value = Math.round((1000 * player.t) / player.length);
  at("play").textContent = player.playing ? "❚❚" : "►";
  at("readout").textContent = figures.map((each) => Math.round(each.frame)).join(" ↔ ");
  curve(at("curve-query"), query.track, score.query, figures[0].frame, "--query-wash");
  curve(at("curve-match"), matches[chosen].track, score.match, score.match.start + matchSeconds(score.match, player.t) * score.match.rate, "--match-wash");
}

function curve(canvas, track, clip, now, wash) {
  const ratio = devicePixelRatio || 1, w = (canvas.width = Math.round(canvas.clientWidth * ratio)), h = (canvas.height = Math.round(canvas.clientHeight * ratio));
  const c = canvas.getContext("2d"), k = 3 * body.joints.indexOf(joint), last = track.first + (track.rows - 1) * track.step;
  let low = Infinity, high = -Infinity;
  for (let row = 0; row < track.rows; row++) for (let a = 0; a < 3; a++) { const v = track.at(row)[k + a]; if (v < low) low = v; if (v > high) high = v; }
  const x = (frame) => 34 * ratio + ((frame - track.first) / Math.max(1, last - track.first)) * (w - 40 * ratio), y = (v) => h - 18 * ratio - ((v - low) / Math.max(1e-6, high - low)) * (h - 30 * ratio);
  c.fillStyle = look(wash); c.fillRect(x(clip.start), 0, x(clip.end) - x(clip.start), h - 16 * ratio);
  c.font = `${11 * ratio}px sans-serif`; c.fillStyle = look("--soft");
  if (high > low) for (const v of [low, (low + high) / 2, high]) c.fillText(v.toFixed(2), 2, y(v) + 4 * ratio);
  for (const frame of [track.first, clip.start, clip.end]) c.fillText(String(frame), x(frame), h - 3 * ratio);
  ["--x", "--y", "--z"].forEach((color, a) => {
    c.strokeStyle = look(color); c.lineWidth = 1.5 * ratio; c.setLineDash(a === 2 ? [5 * ratio, 3 * ratio] : []); c.beginPath();
    let pen = false;
    for (let row = 0; row < track.rows; row++) { const v = track.at(row)[k + a]; if (!Number.isFinite(v)) { pen = false; continue; } const to = [x(track.first + row * track.step), y(v)]; if (pen) c.lineTo(...to); else c.moveTo(...to); pen = true; }
    c.stroke();
  });
  c.setLineDash([]); c.strokeStyle = look("--ink"); c.beginPath(); c.moveTo(x(now), 0); c.lineTo(x(now), h - 16 * ratio); c.stroke();
}

at("matches").append(...content.rows.map(button));
for (const name of body.joints) at("joint").append(new Option(name, name, false, name === joint));
for (const mode of ["overlay", "side", "query"]) at("mode").append(new Option(texts[mode], mode));
at("play").addEventListener("click", () => player.toggle());
at("time").addEventListener("input", (event) => { player.playing = false; player.seek((player.length * event.target.value) / 1000); });
at("speed").addEventListener("change", (event) => { player.speed = Number(event.target.value); });
at("mode").addEventListener("change", (event) => { show.mode = event.target.value; });
at("joint").addEventListener("change", (event) => { joint = event.target.value; });
addEventListener("keydown", (event) => { if (event.key === " " && event.target === document.body) { event.preventDefault(); player.toggle(); } });
stage.orbit(() => {});
if (content.scores.length) {
  open(0);
  const loop = (now) => { requestAnimationFrame(loop); player.tick(now); draw(); };
  requestAnimationFrame(loop);
} else at("told").textContent = texts.no_match;
