import { THREE, OrbitControls } from "nicegui-scene";
import { APART, compose, fill, openTrack, openVoxels, player, save, setAddress, setBody, StickCanvas } from "shosa";
import { Body, FIELD_OF_VIEW, Figure } from "shosa/dancers.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2];
const FILMS = ["video/mp4;codecs=avc1.42E01F", "video/mp4;codecs=vp9", "video/mp4", "video/webm;codecs=vp9", "video/webm"];
const REST_MS = 500; // stillness before and after a film
const MODES = ["overlay", "side", "query"];
const BODY_ASIDE = 1.35; // metres from a figure to its colored body
const TALL_M = 2.55, REACH_M = 1.5; // metres that are in the picture: up, and about each figure
const AT_REST_M = 0.0005; // a step of the camera that nobody sees
const COARSE = 0.75; // share of the pixels across while a processor draws what plays
const AHEAD_S = 4; // seconds of frames that are asked for before they are shown

const looks = { theme: null };
const css = (name) => { // asking for a style each frame is slow
  const theme = document.body.className;
  if (looks.theme !== theme) Object.assign(looks, { theme, found: {} });
  return (looks.found[name] ??= getComputedStyle(document.body).getPropertyValue(name).trim());
};

// Whether WebGL is drawn by the processor, for which smooth edges are too much.
function isSoftware() {
  const context = document.createElement("canvas").getContext("webgl2"), info = context?.getExtension("WEBGL_debug_renderer_info");
  const name = info ? String(context.getParameter(info.UNMASKED_RENDERER_WEBGL)) : "";
  context?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|software/i.test(name);
}

// The track of a take that has voxels only.
function noTrack(joints) {
  const nothing = new Float32Array(3 * joints).fill(NaN);
  return { frame: () => nothing, want: () => Promise.resolve(false) };
}

export default {
  template: `
  <div class="stage" :class="{waiting}">
    <div class="stage-view" ref="view" role="img" :aria-label="texts.stage"></div>
    <div class="stage-top">
      <span v-if="!show?.single" class="segmented" role="group" :aria-label="texts.arrangement">
        <button v-for="m in modes" :key="m" :data-mode="m" :aria-pressed="mode===m" :disabled="m!=='query' && !score?.match" @click="setMode(m)">{{ texts[m] }}</button>
      </span>
      <label v-if="filmed" class="pick">{{ texts.voxels }}
        <select data-control="voxels" v-model="voxels" @change="changed"><option value="off">{{ texts.off }}</option><option value="color">{{ texts.as_filmed }}</option><option value="segments">{{ texts.by_segment }}</option></select>
      </label>
      <label class="pick" v-if="score?.match"><input type="checkbox" data-control="pinned" v-model="pinned" @change="changed" :disabled="mode!=='overlay'"> <span :title="texts.pinned_title">{{ texts.pinned }}</span></label>
      <label class="pick" v-if="score?.match"><input type="checkbox" data-control="warped" v-model="warped" @change="changed"> <span :title="texts.warped_title">{{ texts.warped }}</span></label>
      <label class="pick"><input type="checkbox" data-control="follow" v-model="follow" @change="changed"> {{ texts.follow }}</label>
      <button class="plain" data-control="front" @click="home" :title="texts.front_title">{{ texts.front }}</button>
      <button class="plain" data-control="film" v-if="score" :disabled="filming" @click="film" :title="texts.film_title">{{ filming ? texts.filming : texts.film }}</button>
      <span class="legend"><i class="dot query"></i>{{ score?.match ? texts.query_word : score?.query?.title }}<template v-if="score?.match && mode!=='query'"><i class="dot match"></i>{{ texts.match_word }}</template></span>
    </div>
    <div class="stage-message" v-if="message" role="status">{{ message }}</div>
    <div class="stage-bar" v-show="score">
      <button data-control="play" @click="player.toggle()" :title="texts.play_title" :aria-label="texts.play">{{ playing ? "❚❚" : "►" }}</button>
      <button class="plain" data-control="back" @click="player.step(-1)" :aria-label="texts.back">◂</button>
      <button class="plain" data-control="forth" @click="player.step(1)" :aria-label="texts.forth">▸</button>
      <span class="time"><input type="range" data-control="time" min="0" max="1000" step="1" ref="slider" :aria-label="texts.time" @input="seek"><i v-for="m in score?.marks || []" class="mark" :style="{left: share(m[0]), width: \`max(2px, calc(\${share(m[1] + 1)} - \${share(m[0])}))\`}"></i></span>
      <span class="readout" ref="readout"></span>
      <select data-control="speed" v-model.number="speed" @change="setSpeed" :aria-label="texts.speed"><option v-for="s in speeds" :key="s" :value="s">×{{ s }}</option></select>
      <label class="pick"><input type="checkbox" data-control="loop" v-model="loop" @change="player.loop = loop"> {{ texts.loop }}</label>
    </div>
  </div>`,
  props: { score: Object, body: Object, texts: Object, show: Object, segments: Array },
  data() {
    const show = this.show || {};
    return {
      modes: MODES, speeds: SPEEDS, mode: MODES.includes(show.mode) ? show.mode : "overlay", voxels: show.voxels || "color", pinned: show.pinned !== false,
      warped: show.warped !== false, follow: show.follow !== false, speed: 1, loop: true, playing: false, message: "", waiting: false, filming: false,
    };
  },
  computed: { filmed() { return Boolean(this.score?.query?.voxels || this.score?.match?.voxels); } },
  watch: { score: { handler() { this.load(); } } },
  created() { this.player = player; this.wanted = MODES.includes(this.show?.mode) ? this.show.mode : "overlay"; setBody(this.body.joints, this.body.bones, this.body.otherSide); },
  mounted() {
    this.makeView();
    this.due = 2;
    this.off = player.on(() => { this.wake(); if (this.playing !== player.playing) this.playing = player.playing; });
    this.key = (event) => this.pressed(event);
    window.addEventListener("keydown", this.key);
    window.shosa.stage = { figures: [], bodies: [], mode: this.mode };
    window.shosa.player = player;
    window.shosa.seekFrame = (frame) => { player.playing = false; player.seek((frame - this.score.query.start) / this.score.query.rate); };
    window.shosa.saveFromStage = (what, most) => this.saveFrom(what, most);
    window.shosa.preview = (frame) => { this.previewed = frame; this.wake(); };
    this.load();
  },
  unmounted() {
    this.off();
    this.stopped = true;
    window.removeEventListener("keydown", this.key);
    this.watcher?.disconnect();
    this.dark?.disconnect();
    this.renderer?.dispose();
  },
  methods: {
    makeView() {
      const view = this.$refs.view;
      try {
        this.slow = isSoftware();
        this.renderer = new THREE.WebGLRenderer({ antialias: !this.slow });
      } catch (error) {
        this.flat = new StickCanvas(document.createElement("canvas")); // WebGL is missing
        view.appendChild(this.flat.canvas);
        this.flat.orbit(() => this.wake());
        this.message = this.texts.no_webgl;
      }
      if (this.renderer) {
        view.appendChild(this.renderer.domElement);
        const scene = (this.scene = new THREE.Scene());
        this.camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.05, 60);
        this.orbit = new OrbitControls(this.camera, this.renderer.domElement);
        this.orbit.addEventListener("change", () => this.wake());
        this.dark = new MutationObserver(() => this.wake());
        this.dark.observe(document.body, { attributes: true, attributeFilter: ["class"] });
        this.grid = new THREE.GridHelper(8, 16);
        this.grid.material.vertexColors = false;
        this.light = new THREE.HemisphereLight(0xffffff, 0xb5b0a6, 2.4);
        const sun = new THREE.DirectionalLight(0xffffff, 1.5);
        sun.position.set(2, 4, 3);
        scene.add(this.grid, this.light, sun);
        const parts = [this.body.joints.length, this.body.bones.length + 2, this.body.joints.indexOf("Head")];
        this.figures = { query: new Figure(scene, ...parts), match: new Figure(scene, ...parts) };
        this.bodies = { query: new Body(scene), match: new Body(scene) };
        this.home();
      }
      const fit = () => {
        this.wake();
        const w = Math.max(1, view.clientWidth), h = Math.max(1, view.clientHeight);
        if (this.flat) { this.flat.canvas.width = w * devicePixelRatio; this.flat.canvas.height = h * devicePixelRatio; return; }
        this.renderer.setPixelRatio(this.ratio());
        this.renderer.setSize(w, h);
        this.camera.aspect = w / h;
        this.camera.updateProjectionMatrix();
      };
      (this.watcher = new ResizeObserver(fit)).observe(view);
      fit();
      const loop = (now) => {
        if (this.stopped) return;
        requestAnimationFrame(loop);
        player.tick(now);
        if (this.slow && this.ratio() !== this.renderer.getPixelRatio()) fit(); // fine again at rest
        if (player.playing || this.due > 0) { this.due -= 1; this.draw(); } // nothing is drawn while nothing moves
      };
      requestAnimationFrame(loop);
    },
    ratio() { return Math.min(2, devicePixelRatio) * (this.slow && player.playing && !this.filming ? COARSE : 1); },
    wake() { this.due = 2; }, // frames that are drawn though nothing plays; more while the camera moves
    home() {
      this.wake();
      if (!this.camera) return;
      const aside = this.mode === "side" && this.score?.match ? APART : 0, at = [-aside, aside]; // all that is shown is in the picture
      if (this.bodyShown() && this.score.query.joints !== false) {
        if (this.score.query.voxels) at.push(-aside - BODY_ASIDE);
        if (this.score.match?.voxels && this.mode !== "query") at.push(aside + BODY_ASIDE);
      }
      const low = Math.min(...at), high = Math.max(...at), half = Math.tan((FIELD_OF_VIEW / 2) * (Math.PI / 180));
      const far = Math.max(TALL_M / (2 * half), (high - low + REACH_M) / (2 * half * this.camera.aspect));
      this.orbit.target.set((low + high) / 2, 0.8, 0);
      this.camera.position.set(0.42, 0.36, 1).normalize().multiplyScalar(far).add(this.orbit.target);
      this.middle = { x: 0, z: 0 };
      this.orbit.update();
    },
    bodyShown() { return this.filmed && this.voxels !== "off"; },
    async load() {
      const score = this.score;
      this.tracks = null; this.previewed = null; this.message = this.flat ? this.texts.no_webgl : "";
      if (!score) return;
      if (score.query.version) window.shosa.score = score;
      this.mode = score.match ? this.wanted : "query";
      const tracks = { query: score.query.joints === false ? noTrack(this.body.joints.length) : openTrack(score.query), match: score.match && openTrack(score.match) };
      this.waiting = true;
      try {
        const wanted = [tracks.query.want(score.query.start, Math.min(score.query.end, score.query.start + AHEAD_S * score.query.rate))];
        if (score.match) wanted.push(tracks.match.want(score.match.start, Math.min(score.match.end, score.match.start + AHEAD_S * score.match.rate)));
        await Promise.all(wanted);
        if (score !== this.score) return;
        this.tracks = tracks;
        this.strong = score.strong && score.strong.length < this.body.joints.length ? new Set(score.strong) : null;
        this.setLength();
        player.loop = this.loop;
        player.playing = score.play !== false;
        this.home();
        player.tell();
      } catch (error) {
        if (score !== this.score) return; // something else is shown by now
        this.message = fill(this.texts.not_loaded, { why: error.message });
      }
      this.waiting = false;
    },
    setLength() {
      const { query, match } = this.score, own = (query.end - query.start) / query.rate;
      const other = match && this.mode !== "query" && !this.warped ? (match.end - match.start) / match.rate : 0;
      const t = player.t;
      player.setLength(Math.max(own, other), query.rate);
      player.seek(Math.min(t, player.length));
    },
    share(frame) { return `${(100 * (frame - this.score.query.start)) / Math.max(1, this.score.query.end - this.score.query.start)}%`; },
    setMode(mode) { this.mode = this.wanted = mode; this.changed(); },
    changed() {
      if (this.tracks) this.setLength();
      this.home();
      setAddress({
        mode: this.wanted === "overlay" ? null : this.wanted, voxels: this.voxels === "color" ? null : this.voxels,
        pinned: this.pinned ? null : "no", warped: this.warped ? null : "no", follow: this.follow ? null : "no",
      });
    },
    // Film the stage while the clip is played once, and save the film.
    async film() {
      const canvas = this.$refs.view.querySelector("canvas"), kind = FILMS.find((each) => window.MediaRecorder?.isTypeSupported(each));
      if (!kind) { this.message = this.texts.no_film; return; }
      this.filming = true;
      const recorder = new MediaRecorder(canvas.captureStream(30), { mimeType: kind, videoBitsPerSecond: 8e6 }), parts = [];
      recorder.ondataavailable = (event) => parts.push(event.data);
      const done = new Promise((resolve) => { recorder.onstop = resolve; });
      const rest = () => { this.wake(); return new Promise((resolve) => setTimeout(resolve, REST_MS)); };
      player.loop = false; player.playing = false; player.seek(0);
      recorder.start(REST_MS);
      await rest();
      player.playing = true; player.tell();
      await new Promise((resolve) => { const off = player.on(() => { if (!player.playing) { off(); resolve(); } }); });
      await rest(); // the last frame is in the film too
      recorder.stop();
      await done;
      player.loop = this.loop;
      this.filming = false;
      const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(new Blob(parts, { type: kind })), download: `${this.score.query.take}.${kind.includes("mp4") ? "mp4" : "webm"}` });
      link.click();
      setTimeout(() => URL.revokeObjectURL(link.href), 60000); // the browser reads it in its own time
    },
    // Save a picture from here, or the voxels from this frame on, as the server makes them.
    saveFrom(what, most) {
      const { figures } = window.shosa.stage, motion = this.score?.query;
      if (!motion || !figures.length) return;
      const frame = Math.round(figures[0].frame), take = encodeURIComponent(motion.take);
      if (what === "voxels") { save(`/voxels/${take}/${frame}-${Math.min(motion.end, frame + most - 1)}.glb`, this.texts.not_loaded); return; }
      const from = this.camera ? this.camera.position.clone().sub(this.orbit.target) : { x: Math.sin(this.flat.view.azimuth), y: Math.tan(this.flat.view.elevation), z: Math.cos(this.flat.view.azimuth) };
      const azimuth = Math.atan2(from.x, from.z) + (figures[0].base?.turn || 0), elevation = Math.atan2(from.y, Math.hypot(from.x, from.z));
      save(`/view/${take}/${frame}?azimuth=${azimuth.toFixed(4)}&elevation=${elevation.toFixed(4)}&color=${this.voxels === "segments" ? "segments" : "video"}`, this.texts.not_loaded);
    },
    setSpeed() { player.speed = this.speed; },
    seek(event) { player.playing = false; player.seek((player.length * event.target.value) / 1000); },
    pressed(event) {
      if (event.ctrlKey || event.metaKey || event.altKey || !this.score) return;
      const tag = event.target.tagName;
      if (["INPUT", "SELECT", "TEXTAREA"].includes(tag) && event.target.type !== "checkbox") return;
      if (event.target.closest?.("[role=slider],[role=listbox],[role=combobox]")) return;
      const acts = {
        " ": () => player.toggle(), ArrowLeft: () => player.step(-1), ArrowRight: () => player.step(1), Home: () => player.seek(0), End: () => player.seek(player.length),
        1: () => this.score.match && this.setMode("overlay"), 2: () => this.score.match && this.setMode("side"), 3: () => this.setMode("query"), f: () => this.home(),
      };
      if (!acts[event.key] || (event.key === " " && tag === "BUTTON")) return;
      event.preventDefault();
      acts[event.key]();
    },
    prefetch(figures) {
      for (const { who, frame } of figures) {
        const motion = this.score[who];
        this.tracks[who].want(Math.floor(frame), Math.min(motion.end + 1, frame + AHEAD_S * motion.rate)).then((came) => came && this.wake()).catch((error) => this.fail(error));
      }
    },
    fail(error) { this.message = fill(this.texts.not_loaded, { why: error.message }); },
    draw() {
      if (!this.tracks) { this.render(); return; }
      const show = { mode: this.mode, pinned: this.pinned, realTime: !this.warped };
      let score = this.score, t = player.t;
      if (this.previewed !== null && this.previewed !== undefined) {
        score = { query: { ...score.query, start: Math.min(this.previewed, score.query.start), end: Math.max(this.previewed, score.query.end) }, match: null };
        t = (this.previewed - score.query.start) / score.query.rate;
        this.tracks.query.want(score.query.start, score.query.start + 1).catch((error) => this.fail(error));
      }
      const figures = compose(score, this.tracks, t, show);
      this.prefetch(figures);
      const colors = { query: css("--query"), match: css("--match") }, faint = { query: css("--query-faint"), match: css("--match-faint") };
      const shown = [];
      for (const { who, frame, base, stand } of figures) {
        if (!this.bodyShown() || !score[who]?.voxels || !this.bodies) continue;
        const store = openVoxels(score[who]), n = Math.round(frame), side = score.query.joints === false ? 0 : who === "query" ? -BODY_ASIDE : BODY_ASIDE;
        store.want(n).then((came) => came && this.wake()).catch((error) => this.fail(error));
        store.want(Math.min(score[who].end, n + 15)).catch((error) => this.fail(error));
        const key = `${score[who].take} ${n} ${this.voxels} ${this.mode} ${base?.x}`, voxels = store.frame(n);
        if (voxels) { this.bodies[who].show(voxels, { base, stand: { ...stand, x: stand.x + side } }, this.voxels === "segments" ? this.segments : null, key); shown.push({ who, frame: n, count: voxels.count, colors: this.voxels }); }
        else if (this.bodies[who].points.visible) shown.push({ who, frame: null });
      }
      if (this.bodies) for (const who of ["query", "match"]) if (!shown.some((each) => each.who === who)) this.bodies[who].points.visible = false;
      window.shosa.stage = { figures, bodies: shown, mode: this.mode, frames: (window.shosa.stage.frames || 0) + 1, camera: this.camera && this.camera.position.toArray(), strong: this.strong && [...this.strong] };
      if (this.figures) for (const who of ["query", "match"]) {
        const found = figures.find((each) => each.who === who);
        this.figures[who].show(found?.pose, colors[who], faint[who], this.strong);
      }
      this.followDancer(figures[0]?.pose);
      if (this.flat) {
        this.flat.draw(figures.map((each) => ({ ...each, color: colors[each.who], strong: this.strong })), { background: css("--stage"), grid: css("--grid"), ratio: devicePixelRatio });
      }
      this.render();
      this.tellTime(figures);
    },
    followDancer(pose) {
      if (!this.orbit) return;
      const i = 3 * this.body.joints.indexOf("RHip"), k = 3 * this.body.joints.indexOf("LHip");
      const to = this.follow && pose ? { x: (pose[i] + pose[k]) / 2 + (this.mode === "side" && this.score.match ? APART : 0), z: (pose[i + 2] + pose[k + 2]) / 2 } : { x: 0, z: 0 };
      if (!Number.isFinite(to.x + to.z)) return;
      const dx = (to.x - this.middle.x) * 0.15, dz = (to.z - this.middle.z) * 0.15; // a calm camera
      if (Math.abs(dx) + Math.abs(dz) < AT_REST_M) return;
      this.wake();
      this.middle.x += dx; this.middle.z += dz;
      this.orbit.target.x += dx; this.orbit.target.z += dz;
      this.camera.position.x += dx; this.camera.position.z += dz;
      this.orbit.update();
    },
    render() {
      if (!this.renderer) return;
      const theme = css("--stage");
      if (this.theme !== theme) {
        this.theme = theme;
        this.scene.background = new THREE.Color(theme);
        this.grid.material.color.set(css("--grid"));
      }
      this.renderer.render(this.scene, this.camera);
    },
    tellTime(figures) {
      const slider = this.$refs.slider, readout = this.$refs.readout;
      if (!slider || !readout) return;
      if (document.activeElement !== slider || player.playing) slider.value = Math.round((1000 * player.t) / player.length);
      const [query, match] = figures, about = { frame: Math.round(query.frame), seconds: (query.frame / this.score.query.rate).toFixed(2) };
      let text = fill(this.texts.readout, about);
      if (match) text += fill(this.texts.readout_match, { frame: Math.round(match.frame) });
      if (readout.textContent !== text) readout.textContent = text;
    },
  },
};
