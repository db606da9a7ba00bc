import { fill, openTrack, overview, setBody, strip } from "shosa";

const THUMBNAILS = 9;
const SHORTEST = 2; // frames of a clip

// A take as a bar, and a clip of it between two handles; pose thumbnails below.
export default {
  template: `
  <div class="timeline">
    <div class="timeline-bar" ref="bar" @pointerdown="grab" @pointermove="move" @pointerup="drop" @pointercancel="drop">
      <div class="timeline-clip" :style="{left: share(first), width: \`calc(\${share(last)} - \${share(first)})\`}"></div>
      <div v-for="which in ['first','last']" :key="which" class="timeline-handle" :data-end="which" role="slider" tabindex="0"
        :aria-label="which==='first' ? texts.clip_start : texts.clip_end" :aria-valuemin="0" :aria-valuemax="motion.frames-1" :aria-valuenow="this[which]"
        :style="{left: share(this[which])}" @keydown="nudge($event, which)"></div>
      <div class="timeline-cursor" ref="cursor"></div>
    </div>
    <canvas class="timeline-strip" ref="strip" aria-hidden="true"></canvas>
    <div class="timeline-fields">
      <label>{{ texts.frames }} <input type="number" data-field="first" min="0" :max="motion.frames-1" :value="draft.first ?? first" @input="draft = { first: $event.target.value }" @change="typed($event,'first',1)"></label>
      <label>– <input type="number" data-field="last" min="0" :max="motion.frames-1" :value="draft.last ?? last" @input="draft = { last: $event.target.value }" @change="typed($event,'last',1)"></label>
      <label>{{ texts.seconds }} <input type="number" data-field="first_s" min="0" step="0.1" :value="draft.first_s ?? (first/motion.rate).toFixed(2)" @input="draft = { first_s: $event.target.value }" @change="typed($event,'first',motion.rate)"></label>
      <label>– <input type="number" data-field="last_s" min="0" step="0.1" :value="draft.last_s ?? (last/motion.rate).toFixed(2)" @input="draft = { last_s: $event.target.value }" @change="typed($event,'last',motion.rate)"></label>
    </div>
  </div>`,
  props: { motion: Object, body: Object, texts: Object },
  data() { return { first: this.motion.start, last: this.motion.end, draft: {} }; }, // the draft is what is being typed
  watch: {
    motion(now, before) {
      this.first = now.start; this.last = now.end;
      if (now.take !== before.take || now.version !== before.version) this.drawStrip();
    },
  },
  created() { setBody(this.body.joints, this.body.bones, this.body.otherSide); },
  mounted() {
    this.drawStrip();
    (this.watcher = new ResizeObserver(() => this.drawStrip())).observe(this.$refs.bar);
  },
  unmounted() { this.watcher.disconnect(); },
  methods: {
    share(frame) { return `${(100 * frame) / Math.max(1, this.motion.frames - 1)}%`; },
    at(event) {
      const box = this.$refs.bar.getBoundingClientRect();
      return Math.round(Math.max(0, Math.min(1, (event.clientX - box.left) / box.width)) * (this.motion.frames - 1));
    },
    grab(event) {
      const at = this.at(event), wide = this.$refs.bar.clientWidth / Math.max(1, this.motion.frames - 1);
      const near = (frame) => Math.abs(at - frame) * wide;
      if (Math.min(near(this.first), near(this.last)) <= 14) this.held = near(this.first) <= near(this.last) && !(this.first === this.last && at > this.last) ? "first" : "last";
      else if (at > this.first && at < this.last) this.held = "both";
      else { this.held = at < this.first ? "first" : "last"; this.set(this.held, at); }
      this.from = at - this.first;
      this.$refs.bar.setPointerCapture(event.pointerId);
      event.preventDefault();
    },
    move(event) {
      if (!this.held) return;
      const at = this.at(event);
      if (this.held === "both") {
        const long = this.last - this.first;
        this.first = Math.max(0, Math.min(this.motion.frames - 1 - long, at - this.from));
        this.last = this.first + long;
        window.shosa.preview?.(this.first);
      } else this.set(this.held, at);
    },
    drop() {
      if (!this.held) return;
      this.held = null;
      this.tell();
    },
    set(which, frame) {
      const most = this.motion.frames - 1;
      if (which === "first") this.first = Math.max(0, Math.min(frame, this.last - SHORTEST + 1));
      else this.last = Math.min(most, Math.max(frame, this.first + SHORTEST - 1));
      window.shosa.preview?.(this[which]);
    },
    nudge(event, which) {
      const step = { ArrowLeft: -1, ArrowRight: 1, PageDown: -Math.round(this.motion.rate), PageUp: Math.round(this.motion.rate) }[event.key];
      if (!step) return;
      event.preventDefault();
      this.set(which, this[which] + (event.shiftKey ? 10 : 1) * step);
      clearTimeout(this.later);
      this.later = setTimeout(() => this.tell(), 350);
    },
    typed(event, which, scale) {
      const value = Number(event.target.value);
      this.draft = {};
      if (Number.isFinite(value) && event.target.value !== "") {
        const frame = Math.max(0, Math.min(this.motion.frames - 1, Math.round(value * scale)));
        if (which === "first" && frame > this.last) this.last = Math.min(this.motion.frames - 1, frame + SHORTEST - 1);
        if (which === "last" && frame < this.first) this.first = Math.max(0, frame - SHORTEST + 1);
        this.set(which, frame);
      }
      event.target.value = scale === 1 ? this[which] : (this[which] / this.motion.rate).toFixed(2);
      this.tell();
    },
    tell() {
      window.shosa.preview?.(null);
      this.$emit("clip", { first: this.first, last: this.last });
    },
    async drawStrip() {
      const canvas = this.$refs.strip, motion = this.motion;
      if (!canvas) return;
      try {
        const track = await overview(motion, 0, motion.frames - 1, 4 * THUMBNAILS);
        if (motion !== this.motion || !this.$refs.strip) return;
        canvas.width = Math.max(1, canvas.clientWidth * devicePixelRatio); canvas.height = Math.max(1, canvas.clientHeight * devicePixelRatio);
        const rows = Array.from({ length: THUMBNAILS }, (_, n) => Math.min(track.rows - 1, Math.round(((n + 0.5) / THUMBNAILS) * (track.rows - 1))));
        strip(canvas, rows.map((row) => track.at(row)), getComputedStyle(document.body).getPropertyValue("--soft-ink").trim(), devicePixelRatio);
        this.$el.dataset.drawn = motion.take;
      } catch (error) { if (motion === this.motion) this.$emit("fault", { why: error.message }); }
    },
  },
};
