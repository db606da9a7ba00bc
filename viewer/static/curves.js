import { fill, matchSeconds, overview, player } from "shosa";

const AXES = [["x", "--axis-x", []], ["y", "--axis-y", []], ["z", "--axis-z", [5, 3]]];
const AROUND_S = 60; // seconds of a take that are drawn at most
const MOST = 1200; // rows that are fetched for a curve
const css = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();

// The joint's curves of query and match, clips shaded; or why the match is near.
export default {
  template: `
  <div class="curves">
    <div class="curves-head">
      <span class="segmented small" role="group"><button data-tab="curves" :aria-pressed="tab==='curves'" @click="setTab('curves')">{{ texts.curves }}</button><button data-tab="near" :disabled="!score?.match" :aria-pressed="tab==='near'" @click="setTab('near')">{{ texts.why_near }}</button></span>
      <label v-show="tab==='curves'">{{ texts.joint }} <select data-control="joint" v-model="joint" @change="chooseJoint"><option v-for="j in body.joints" :key="j">{{ j }}</option></select></label>
      <span class="axes" v-show="tab==='curves'"><span v-for="[name, color] in axes" :key="name"><i class="dash" :class="name" :style="{background: \`var(\${color})\`}"></i>{{ name }}</span> {{ texts.meters }}</span>
    </div>
    <div class="curves-plots">
      <figure v-for="who in plots" :key="who" :data-plot="who"><figcaption>{{ captions[who] }}</figcaption><div class="plot"><canvas :ref="who" @pointerdown="jump($event, who)"></canvas><i class="plot-cursor" :ref="who + '-cursor'"></i></div></figure>
    </div>
  </div>`,
  props: { score: Object, body: Object, texts: Object, chosen: String },
  data() { return { joint: this.chosen || "RWrist", tab: "curves", captions: {}, axes: AXES }; },
  computed: { plots() { return this.tab === "near" ? ["along", "joints"] : this.score?.match ? ["query", "match"] : ["query"]; } },
  watch: { score() { if (!this.score?.match) this.tab = "curves"; this.load(); }, chosen() { if (this.chosen) { this.joint = this.chosen; this.load(); } } },
  mounted() {
    this.off = player.on(() => this.schedule());
    (this.watcher = new ResizeObserver(() => this.schedule(true))).observe(this.$el);
    this.load();
  },
  unmounted() { this.off(); this.watcher.disconnect(); },
  methods: {
    setTab(tab) { this.tab = tab; this.$nextTick(() => this.schedule(true)); },
    chooseJoint() { this.$emit("joint"); window.shosa.setAddress({ joint: this.joint }); this.load(); },
    canvas(who) { const found = this.$refs[who]; return Array.isArray(found) ? found[0] : found; },
    async load() {
      const score = this.score;
      this.data = {};
      if (!score) return;
      try {
        for (const who of ["query", "match"]) {
          const m = score[who];
          if (!m) continue;
          const around = Math.round(AROUND_S * m.rate), long = m.end - m.start + 1, whole = m.frames <= around;
          const extra = Math.max(0, Math.round((around - long) / 2));
          const start = whole ? 0 : Math.max(0, m.start - extra), end = whole ? m.frames - 1 : Math.min(m.frames - 1, m.end + extra);
          const track = await overview(m, start, end, MOST);
          if (score !== this.score) return;
          this.data[who] = { track, start, end };
          this.captions[who] = fill(this.texts.caption, { joint: this.joint, title: m.title, first: m.start, last: m.end });
        }
        if (score.match) { this.captions.along = this.texts.along; this.captions.joints = this.texts.by_joint; }
      } catch (error) { if (score === this.score) this.captions.query = fill(this.texts.not_loaded, { why: error.message }); }
      this.$nextTick(() => this.schedule(true));
    },
    schedule(afresh) {
      if (afresh) this.pictures = {};
      if (this.due) return;
      this.due = requestAnimationFrame(() => { this.due = null; this.plots.forEach((who) => this.draw(who)); });
    },
    draw(who) {
      const canvas = this.canvas(who);
      if (!canvas || !this.score || (who in { query: 1, match: 1 } && !this.data?.[who])) return;
      const ratio = devicePixelRatio, w = Math.round(canvas.clientWidth * ratio), h = Math.round(canvas.clientHeight * ratio);
      if (w < 10 || h < 10) return;
      this.pictures ||= {};
      const theme = document.body.className;
      if (this.theme !== theme) { this.theme = theme; this.pictures = {}; }
      let held = this.pictures[who];
      if (!held || canvas.width !== w || canvas.height !== h || held.canvas !== canvas) { // the curves are drawn once, the cursor is moved
        canvas.width = w; canvas.height = h;
        held = this.pictures[who] = { canvas };
        held.plot = { query: this.paintCurve, match: this.paintCurve, along: this.paintAlong, joints: this.paintJoints }[who].call(this, canvas.getContext("2d"), who, w, h, ratio);
      }
      const at = this.cursor(who, held.plot), line = this.canvas(`${who}-cursor`), seen = at !== null && held.plot;
      line.style.visibility = seen ? "visible" : "hidden";
      if (seen) {
        line.style.transform = `translateX(${held.plot.x(at) / ratio}px)`;
        (window.shosa.cursors ||= {})[who] = at;
      }
    },
    cursor(who) {
      const { query, match } = this.score;
      if (who === "joints") return null;
      if (who === "along") return Math.min(player.t, (query.end - query.start) / query.rate);
      if (who === "query") return Math.min(query.end, query.start + player.t * query.rate);
      const warped = !document.querySelector('[data-control="warped"]') || document.querySelector('[data-control="warped"]').checked;
      return Math.min(match.end, match.start + (warped ? matchSeconds(match, player.t) : player.t) * match.rate);
    },
    frameOf(c, w, h, ratio, [x0, x1], [y0, y1], labelX) {
      const left = 38 * ratio, right = w - 8 * ratio, top = 6 * ratio, bottom = h - 18 * ratio;
      const x = (v) => left + ((v - x0) / Math.max(1e-9, x1 - x0)) * (right - left), y = (v) => bottom - ((v - y0) / Math.max(1e-9, y1 - y0)) * (bottom - top);
      c.font = `${11 * ratio}px ${css("--font") || "sans-serif"}`;
      c.strokeStyle = css("--rule"); c.fillStyle = css("--soft-ink"); c.lineWidth = ratio;
      const nice = (span, count) => { const raw = span / count, p = 10 ** Math.floor(Math.log10(raw)); return [1, 2, 5, 10].find((k) => k * p >= raw) * p; };
      const dx = nice(Math.max(x1 - x0, 1e-9), 5), dy = nice(Math.max(y1 - y0, 1e-9), 4);
      c.textAlign = "center"; c.textBaseline = "top";
      for (let v = Math.ceil(x0 / dx) * dx; v <= x1 + 1e-9; v += dx) { c.beginPath(); c.moveTo(x(v), top); c.lineTo(x(v), bottom); c.stroke(); c.fillText(labelX(v), x(v), bottom + 4 * ratio); }
      c.textAlign = "right"; c.textBaseline = "middle";
      for (let v = Math.ceil(y0 / dy) * dy; v <= y1 + 1e-9; v += dy) { c.beginPath(); c.moveTo(left, y(v)); c.lineTo(right, y(v)); c.stroke(); c.fillText(`${+v.toFixed(4)}`, left - 5 * ratio, y(v)); }
      return { x, y, top, bottom, left, right, back: (px) => x0 + ((px - left) / (right - left)) * (x1 - x0) };
    },
    paintCurve(c, who, w, h, ratio) {
      const { track, start, end } = this.data[who], m = this.score[who], k = 3 * this.body.joints.indexOf(this.joint);
      let low = Infinity, high = -Infinity;
      for (let row = 0; row < track.rows; row++) for (let a = 0; a < 3; a++) { const v = track.at(row)[k + a]; if (v < low) low = v; if (v > high) high = v; }
      if (!(high > -Infinity)) { c.fillStyle = css("--soft-ink"); c.font = `${13 * ratio}px sans-serif`; c.fillText(fill(this.texts.no_joint, { joint: this.joint }), 12 * ratio, 24 * ratio); return null; }
      const pad = 0.06 * (high - low) + 0.02, plot = this.frameOf(c, w, h, ratio, [start, end], [low - pad, high + pad], (v) => `${Math.round(v)}`);
      c.fillStyle = css(who === "query" ? "--query-wash" : "--match-wash");
      c.fillRect(plot.x(m.start), plot.top, Math.max(2, plot.x(m.end) - plot.x(m.start)), plot.bottom - plot.top);
      AXES.forEach(([, color, dash], a) => {
        c.strokeStyle = css(color); c.lineWidth = 1.6 * ratio; c.setLineDash(dash.map((v) => v * ratio));
        c.beginPath();
        let pen = false;
        for (let row = 0; row < track.rows; row++) {
          const v = track.at(row)[k + a], px = plot.x(track.first + row * track.step);
          if (!Number.isFinite(v)) { pen = false; continue; }
          if (pen) c.lineTo(px, plot.y(v)); else c.moveTo(px, plot.y(v));
          pen = true;
        }
        c.stroke();
      });
      c.setLineDash([]);
      return plot;
    },
    paintAlong(c, who, w, h, ratio) {
      const { path, near } = this.score.match, seconds = path.map((p) => p[0]);
      const plot = this.frameOf(c, w, h, ratio, [0, seconds[seconds.length - 1] || 1], [0, 1.1 * Math.max(...near, 1e-4)], (v) => `${+v.toFixed(2)} s`);
      c.fillStyle = css("--match-wash"); c.strokeStyle = css("--match"); c.lineWidth = 1.6 * ratio;
      c.beginPath();
      near.forEach((v, n) => c.lineTo(plot.x(seconds[n]), plot.y(v)));
      c.stroke();
      c.lineTo(plot.x(seconds[seconds.length - 1]), plot.bottom); c.lineTo(plot.x(0), plot.bottom); c.fill();
      return plot;
    },
    paintJoints(c, who, w, h, ratio) {
      const found = this.body.joints.map((joint, k) => [joint, this.score.match.byJoint[k]]).filter(([, v]) => v !== null).sort((a, b) => b[1] - a[1]);
      const columns = found.length > 8 ? 2 : 1, rows = Math.ceil(found.length / columns), cell = Math.min(22 * ratio, h / rows), most = Math.max(...found.map(([, v]) => v), 1e-6);
      c.font = `${Math.min(12 * ratio, 0.75 * cell)}px sans-serif`; c.textBaseline = "middle";
      found.forEach(([joint, v], n) => {
        const x = Math.floor(n / rows) * (w / columns), y = (n % rows) * cell, wide = w / columns - 140 * ratio;
        c.fillStyle = css("--ink"); c.textAlign = "left"; c.fillText(joint, x + 4 * ratio, y + cell / 2);
        c.fillStyle = css("--match"); c.fillRect(x + 78 * ratio, y + 0.25 * cell, Math.max(1, (wide * v) / most), 0.5 * cell);
        c.fillStyle = css("--soft-ink"); c.fillText(v.toFixed(3), x + 84 * ratio + (wide * v) / most, y + cell / 2);
      });
      return null;
    },
    jump(event, who) {
      const plot = this.pictures?.[who]?.plot;
      if (!plot) return;
      const at = plot.back(event.offsetX * devicePixelRatio), { query, match } = this.score;
      const seconds = who === "along" ? at : who === "query" ? (at - query.start) / query.rate : querySeconds(match, (at - match.start) / match.rate);
      player.playing = false;
      player.seek(seconds);
    },
  },
};

// Seconds of the query at which it does what the match does at `t` seconds.
function querySeconds(match, t) {
  const found = match.path.find((pair) => pair[1] >= t);
  return (found || match.path[match.path.length - 1])[0];
}
