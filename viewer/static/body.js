import { fill, hipsOf, linesOf, openVoxels, setBody } from "shosa";

const TALL_M = 2.1, WIDE_M = 2.0, MIDDLE_M = 0.95; // metres that the view is at least high and wide, and what is in its middle
const UNDONE_AT_MOST = 100;
const THINNEST_M = 0.01, WIDEST_M = 0.15; // radius of the brush
const css = (name) => getComputedStyle(document.body).getPropertyValue(name).trim();
const copy = (value) => JSON.parse(JSON.stringify(value));

// A frame's voxels in the colors of their segments, and the joints to drag.
export default {
  template: `
  <div class="body-editor">
    <section class="body-view" ref="view">
      <canvas ref="canvas" :class="{brush: moving==='brush'}" @pointerdown="press" @pointermove="hoverAt" @pointerleave="pointer = null" @wheel.prevent="zoom"></canvas>
      <svg ref="handles" class="body-handles" aria-hidden="false">
        <line v-for="(l, n) in lines" :key="'l'+n" :x1="l[0]" :y1="l[1]" :x2="l[2]" :y2="l[3]"></line>
        <circle v-if="moving==='brush' && pointer" class="brush" :cx="pointer[0]" :cy="pointer[1]" :r="radius * pixelsPerMetre()"></circle>
        <g v-for="h in handles" :key="h.name + h.kind" :class="['handle', h.kind, {held: held && held.name===h.name, moved: h.moved}]" :data-joint="h.name" :data-kind="h.kind" tabindex="0" role="button" :aria-label="h.name"
          @pointerdown.stop.prevent="grab($event, h)" @keydown="nudge($event, h)" @pointerenter="hover=h.name" @pointerleave="hover=''">
          <circle v-if="h.kind==='joint'" :cx="h.x" :cy="h.y" r="9"></circle>
          <rect v-else :x="h.x-8" :y="h.y-8" width="16" height="16" :transform="'rotate(45 '+h.x+' '+h.y+')'"></rect>
          <text v-if="hover===h.name || (held && held.name===h.name)" :x="h.x+14" :y="h.y+4">{{ h.name }}</text>
        </g>
      </svg>
      <div class="stage-top">
        <span class="segmented" role="group"><button data-view="front" :aria-pressed="facing==='front'" @click="look('front')">{{ texts.front }}</button><button data-view="side" :aria-pressed="facing==='side'" @click="look('side')">{{ texts.from_side }}</button><button data-view="back" :aria-pressed="facing==='back'" @click="look('back')">{{ texts.from_back }}</button></span>
        <span class="segmented" role="group" :aria-label="texts.to_move"><button data-move="joints" :aria-pressed="moving==='joints'" @click="moving='joints'">{{ texts.joints }}</button><button data-move="boundaries" :aria-pressed="moving==='boundaries'" @click="moving='boundaries'">{{ texts.boundaries }}</button><button data-move="brush" :aria-pressed="moving==='brush'" @click="moving='brush'">{{ texts.brush }}</button></span>
        <label v-if="moving==='brush'" class="pick">{{ texts.brush_size }} <input type="range" data-control="radius" :min="thinnest" :max="widest" step="0.005" v-model.number="radius"></label>
        <button data-control="undo" :disabled="!past.length" @click="undo">{{ texts.undo }}</button>
        <label class="pick">{{ texts.frame }} <input type="number" data-control="frame" min="0" :max="content.motion.frames-1" :value="content.frame" @change="openFrame($event.target.value)"></label>
      </div>
      <div class="stage-message" v-if="message" role="alert">{{ message }}</div>
    </section>
    <aside class="body-side">
      <select data-control="take" :value="content.motion.take" @change="openTake($event.target.value)" :aria-label="texts.recording"><option v-for="(title, take) in content.filmed" :key="take" :value="take">{{ title }}</option></select>
      <p class="soft">{{ texts['start_' + content.source] }} {{ texts['how_' + moving] }}</p>
      <table class="shares" :class="{choosing: moving==='brush'}"><tr v-for="(name, n) in content.segments" :key="name" :data-segment="name" :aria-selected="moving==='brush' ? segment===n+1 : null" :tabindex="moving==='brush' ? 0 : -1" @click="choose(n+1)" @keydown.enter="choose(n+1)"><td><i class="swatch" :style="{background: 'rgb(' + content.colors[n+1].join() + ')'}"></i></td><td>{{ texts['segment_' + name] || name }}</td><td class="number">{{ shares ? (100 * shares[n]).toFixed(1) + ' %' : '…' }}</td></tr></table>
      <label class="pick"><input type="checkbox" data-control="both" v-model="both"> {{ texts.both_sides }}</label>
      <label class="pick"><input type="checkbox" data-control="captured" v-model="captured" @change="draw"> {{ texts.captured_colors }}</label>
      <button class="main" data-control="save" :disabled="!content.capture || saving" @click="save">{{ texts.use_model }}</button>
      <button data-control="download" @click="download">{{ texts.download_model }}</button>
      <p role="status" data-saved>{{ told }}</p>
      <template v-if="saved || work"><button data-control="digitize" :disabled="work && work.running" @click="digitize">{{ texts.digitize }}</button>
        <p class="soft">{{ texts.then_run }} <code>{{ content.command }}</code></p>
        <p v-if="work" role="status" data-work><span v-if="work.running" class="progress" style="display:block"></span>{{ work.running ? work.said : (work.code === 0 ? texts.digitized : fill(texts.not_digitized, { said: work.said })) }} <a v-if="work.code === 0" :href="'/browse?take=' + encodeURIComponent(content.motion.take)">{{ texts.browse }}</a></p></template>
      <p v-if="!content.capture" class="soft">{{ texts.no_capture }}</p>
    </aside>
  </div>`,
  props: { content: Object, body: Object, texts: Object },
  data() {
    return { joints: copy(this.content.joints), bounds: {}, touches: [], kept: this.content.labeled, segment: 2, radius: 0.04, thinnest: THINNEST_M, widest: WIDEST_M, pointer: null, past: [], shares: null, both: true, captured: false, moving: "joints", facing: "front", azimuth: 0, scale: 1, held: null, hover: "", told: "", message: "", saved: false, saving: false, work: null, size: [1, 1], digest: this.content.digest };
  },
  computed: {
    handles() {
      if (this.moving === "brush") return [];
      const place = (name, p, kind, moved) => { const [x, y] = this.project(p); return { name, kind, x, y, moved }; };
      if (this.moving === "joints") return this.body.joints.flatMap((name, k) => (this.joints[k] ? [place(name, this.joints[k], "joint", false)] : []));
      return this.content.boundaries.flatMap((name) => { const at = this.bounds[name] || this.joints[this.body.joints.indexOf(name)]; return at ? [place(name, at, "boundary", Boolean(this.bounds[name]))] : []; });
    },
    lines() { return linesOf(this.flat()).map(([a, b]) => [this.joints[a], this.joints[b]]).filter(([a, b]) => a && b).map(([a, b]) => [...this.project(a).slice(0, 2), ...this.project(b).slice(0, 2)]); },
  },
  created() {
    setBody(this.body.joints, this.body.bones, this.body.otherSide);
    const hips = hipsOf(this.flat());
    this.base = Number.isFinite(hips.x + hips.turn) ? hips : { x: 0, z: 0, turn: 0 };
  },
  async mounted() {
    this.key = (event) => { if ((event.ctrlKey || event.metaKey) && event.key === "z") { event.preventDefault(); this.undo(); } };
    window.addEventListener("keydown", this.key);
    (this.watcher = new ResizeObserver(() => { this.size = [this.$refs.view.clientWidth, this.$refs.view.clientHeight]; this.draw(); })).observe(this.$refs.view);
    window.shosa.bodyModel = { labels: null };
    try {
      const store = openVoxels(this.content.motion);
      await store.want(this.content.frame);
      this.voxels = store.frame(this.content.frame);
      this.draw();
      await this.ask();
    } catch (error) { this.message = fill(this.texts.not_loaded, { why: error.message }); }
  },
  unmounted() { window.removeEventListener("keydown", this.key); this.watcher.disconnect(); },
  methods: {
    fill,
    async digitize() {
      const address = `/digitize/${encodeURIComponent(this.content.motion.take)}`;
      let answer = await fetch(address, { method: "POST" });
      if (!answer.ok) { this.told = await answer.text(); return; }
      this.work = await answer.json();
      while (this.work.running) {
        await new Promise((resolve) => setTimeout(resolve, 1500));
        answer = await fetch(address);
        this.work = await answer.json();
      }
    },
    flat() { return Float32Array.from(this.joints.flatMap((p) => p || [NaN, NaN, NaN])); },
    pixelsPerMetre() { return Math.min(this.size[1] / TALL_M, this.size[0] / WIDE_M) * this.scale; },
    // where a point of the world is on the screen, and how near it is
    project(p) {
      const [w, h] = this.size, zoom = this.pixelsPerMetre(), turn = this.azimuth - this.base.turn, C = Math.cos(turn), S = Math.sin(turn);
      const dx = p[0] - this.base.x, dz = p[2] - this.base.z;
      return [w / 2 + zoom * (C * dx + S * dz), h / 2 - zoom * (p[1] - MIDDLE_M), C * dz - S * dx];
    },
    // the step in the world that a step on the screen is
    step(dx, dy) {
      const zoom = this.pixelsPerMetre(), turn = this.azimuth - this.base.turn;
      return [(dx / zoom) * Math.cos(turn), -dy / zoom, (dx / zoom) * Math.sin(turn)];
    },
    look(facing) { this.facing = facing; this.azimuth = { front: 0, side: -Math.PI / 2, back: Math.PI }[facing]; this.draw(); },
    choose(segment) { if (this.moving === "brush") this.segment = segment; },
    hoverAt(event) { this.pointer = [event.offsetX, event.offsetY]; },
    press(event) {
      const at = this.moving === "brush" ? this.pick(event.offsetX, event.offsetY) : -1;
      if (at < 0) { this.turn(event); return; }
      const canvas = this.$refs.canvas;
      this.remember();
      this.touch(at);
      canvas.setPointerCapture(event.pointerId);
      const move = (e) => { const next = this.pick(e.offsetX, e.offsetY); if (next >= 0) this.touch(next); };
      canvas.addEventListener("pointermove", move);
      canvas.addEventListener("pointerup", () => { canvas.removeEventListener("pointermove", move); this.ask(); }, { once: true });
    },
    // the voxel that is drawn at a place on the screen, -1 where there is none
    pick(x, y) {
      const canvas = this.$refs.canvas, column = Math.round(x * devicePixelRatio), row = Math.round(y * devicePixelRatio);
      return this.drawn && column >= 0 && row >= 0 && column < canvas.width && row < canvas.height ? this.drawn[row * canvas.width + column] : -1;
    },
    // paint the voxels about one; the server paints those inside too
    touch(voxel) {
      const at = [0, 1, 2].map((k) => this.voxels.place[3 * voxel + k]), last = this.touches[this.touches.length - 1];
      if (last && last[3] === this.radius && last[4] === this.segment && Math.hypot(...at.map((v, k) => v - last[k])) < this.radius / 3 && this.touching) return;
      this.touching = true;
      this.touches.push([...at.map((v) => Math.round(v * 1e4) / 1e4), this.radius, this.segment]);
      const { place, count } = this.voxels, r = this.radius ** 2;
      for (let i = 0; this.labels && i < count; i++) if ((place[3 * i] - at[0]) ** 2 + (place[3 * i + 1] - at[1]) ** 2 + (place[3 * i + 2] - at[2]) ** 2 <= r) this.labels[i] = this.segment;
      this.draw();
    },
    turn(event) {
      const from = event.clientX, was = this.azimuth, canvas = this.$refs.canvas;
      canvas.setPointerCapture(event.pointerId);
      const move = (e) => { this.azimuth = was + (e.clientX - from) / 150; this.facing = ""; this.draw(); };
      canvas.addEventListener("pointermove", move);
      canvas.addEventListener("pointerup", () => canvas.removeEventListener("pointermove", move), { once: true });
    },
    zoom(event) { this.scale = Math.max(0.6, Math.min(4, this.scale * Math.exp(-event.deltaY / 900))); this.draw(); },
    remember() { this.touching = false; this.past.push(copy({ joints: this.joints, bounds: this.bounds, touches: this.touches, kept: this.kept })); if (this.past.length > UNDONE_AT_MOST) this.past.shift(); this.saved = false; this.told = ""; },
    undo() { const before = this.past.pop(); if (!before) return; Object.assign(this, before); this.ask(); },
    grab(event, handle) {
      this.remember();
      this.held = handle;
      let last = [event.clientX, event.clientY];
      const move = (e) => { this.shift(handle, this.step(e.clientX - last[0], e.clientY - last[1])); last = [e.clientX, e.clientY]; this.ask(); };
      const drop = () => { window.removeEventListener("pointermove", move); window.removeEventListener("pointerup", drop); this.held = null; this.ask(); };
      window.addEventListener("pointermove", move);
      window.addEventListener("pointerup", drop);
    },
    nudge(event, handle) {
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key];
      if (!by) return;
      event.preventDefault();
      this.remember();
      this.shift(handle, this.step(...by.map((v) => v * (event.shiftKey ? 10 : 2))));
      this.ask();
    },
    shift(handle, d) {
      this.kept = false; // the labels follow what is moved
      const names = [handle.name], other = this.body.joints[this.body.otherSide[this.body.joints.indexOf(handle.name)]];
      if (this.both && other !== handle.name) names.push(other);
      names.forEach((name, n) => {
        const k = this.body.joints.indexOf(name), t = this.base.turn, across = [Math.cos(t), -Math.sin(t)];
        const aside = d[0] * across[0] + d[2] * across[1], step = n ? [d[0] - 2 * aside * across[0], d[1], d[2] - 2 * aside * across[1]] : d;
        const from = handle.kind === "joint" ? this.joints[k] : this.bounds[name] || this.joints[k];
        if (!from) return;
        const to = from.map((v, i) => v + step[i]);
        if (handle.kind === "joint") this.joints[k] = to; else this.bounds[name] = to;
      });
    },
    model() { return { joints: this.joints, boundaries: this.bounds, touches: this.touches, kept: this.kept, digest: this.digest }; },
    address(what) { const m = this.content.motion; return `/body/${what}/${encodeURIComponent(m.take)}/${encodeURIComponent(m.version)}/${this.content.frame}`; },
    async ask() { // one question at a time; the last state is always asked for
      if (this.asking) { this.again = true; return; }
      this.asking = true;
      try {
        const answer = await fetch(this.address("labels"), { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(this.model()) });
        if (!answer.ok) throw new Error(await answer.text());
        this.shares = JSON.parse(answer.headers.get("x-shares"));
        this.labels = new Uint8Array(await answer.arrayBuffer());
        this.message = "";
        window.shosa.bodyModel = { labels: this.labels, shares: this.shares, joints: copy(this.joints), bounds: copy(this.bounds), touches: this.touches.length };
      } catch (error) { this.message = error.message; }
      this.asking = false;
      this.draw();
      if (this.again) { this.again = false; this.ask(); }
    },
    draw() {
      if (this.due) return;
      this.due = requestAnimationFrame(() => { this.due = null; this.paint(); });
    },
    paint() {
      const canvas = this.$refs.canvas;
      if (!canvas) return;
      const ratio = devicePixelRatio, [w, h] = this.size;
      canvas.width = w * ratio; canvas.height = h * ratio;
      const image = new ImageData(canvas.width, canvas.height), pixels = new Uint32Array(image.data.buffer), near = new Float32Array(pixels.length).fill(-Infinity), drawn = (this.drawn = new Int32Array(pixels.length).fill(-1));
      const background = css("--stage").match(/\w\w/g).map((v) => parseInt(v, 16));
      pixels.fill((255 << 24) | (background[2] << 16) | (background[1] << 8) | background[0]);
      const v = this.voxels;
      if (v) {
        const side = Math.max(1, Math.ceil(v.voxel_m * this.pixelsPerMetre() * ratio));
        for (let i = 0; i < v.count; i++) {
          const [x, y, z] = this.project([v.place[3 * i], v.place[3 * i + 1], v.place[3 * i + 2]]);
          const label = this.labels ? this.labels[i] : 0;
          const rgb = this.captured || !this.labels ? [0, 1, 2].map((k) => v.palette[3 * v.color[i] + k]) : this.content.colors[label];
          const shade = 0.82 + 0.18 * Math.max(-1, Math.min(1, z * 4)), color = (255 << 24) | ((rgb[2] * shade) << 16) | ((rgb[1] * shade) << 8) | (rgb[0] * shade);
          const x0 = Math.round(x * ratio - side / 2), y0 = Math.round(y * ratio - side / 2);
          for (let row = Math.max(0, y0); row < Math.min(canvas.height, y0 + side); row++)
            for (let column = Math.max(0, x0); column < Math.min(canvas.width, x0 + side); column++) {
              const at = row * canvas.width + column;
              if (near[at] < z) { near[at] = z; pixels[at] = color; drawn[at] = i; }
            }
        }
      }
      canvas.getContext("2d").putImageData(image, 0, 0);
    },
    async save() {
      this.saving = true;
      try {
        const answer = await fetch(this.address("save"), { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(this.model()) });
        if (!answer.ok) throw new Error(await answer.text());
        const { path, digest } = await answer.json();
        this.digest = digest; this.saved = true;
        this.told = fill(this.texts.model_saved, { path });
      } catch (error) { this.told = error.message; this.saved = false; }
      this.saving = false;
    },
    async download() {
      const answer = await fetch(this.address("download"), { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(this.model()) });
      if (!answer.ok) { this.told = await answer.text(); return; }
      const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(await answer.blob()), download: "initial.json" });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60000); // the browser reads it in its own time
    },
    openFrame(text) { if (/^\d+$/.test(text)) location.href = `/body?take=${encodeURIComponent(this.content.motion.take)}&frame=${Number(text)}`; },
    openTake(take) { location.href = `/body?take=${encodeURIComponent(take)}`; },
  },
};
