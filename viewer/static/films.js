import { fill, player } from "shosa";

// The films of a capture, small, in step with the stage: the newest frame is asked for as soon as
// the one before is there.
export default {
  template: `
  <aside class="films" v-if="motion" :aria-label="texts.films">
    <div class="films-head"><b>{{ texts.films }} <small v-if="picture">{{ at }}</small></b>
      <select v-if="cameras.length" data-control="camera" v-model="camera" @change="shown = -1; next()" :aria-label="texts.camera"><option value="">{{ texts.all_cameras }}</option><option v-for="name in cameras" :key="name" :value="name">{{ name }}</option></select></div>
    <div class="films-picture" v-show="picture"><img ref="picture" :src="picture" :alt="texts.films">
      <span v-if="!camera" class="films-names" :style="{gridTemplateColumns: 'repeat(' + columns + ', 1fr)'}"><button v-for="name in cameras" :key="name" class="plain" :title="name" @click="camera = name; shown = -1; next()">{{ name }}</button></span></div>
    <p v-if="message" class="soft" role="status">{{ message }}</p>
  </aside>`,
  props: { motion: Object, texts: Object },
  data() { return { cameras: [], columns: 1, camera: "", picture: "", message: "", at: 0 }; },
  watch: { motion() { this.open(); } },
  mounted() { this.off = player.on(() => this.next()); this.open(); },
  unmounted() { this.off(); this.release(); },
  methods: {
    address() { return `/films/${encodeURIComponent(this.motion.take)}/${encodeURIComponent(this.motion.version)}`; },
    release() { if (this.picture) URL.revokeObjectURL(this.picture); },
    async open() {
      const motion = this.motion;
      Object.assign(this, { cameras: [], camera: "", picture: "", message: motion ? this.texts.opening_films : "", shown: -1 });
      window.shosa.film = null;
      if (!motion) return;
      try {
        const answer = await fetch(this.address());
        const said = answer.ok ? await answer.json() : await answer.text();
        if (motion !== this.motion) return; // another recording is shown by now
        if (!answer.ok) { this.message = said; return; }
        Object.assign(this, { cameras: said.cameras, columns: said.columns, message: said.why });
        this.next();
      } catch (error) { if (motion === this.motion) this.message = fill(this.texts.not_loaded, { why: error.message }); }
    },
    async next() {
      if (this.coming || !this.cameras.length) return;
      const { motion, camera } = this, frame = Math.min(motion.frames - 1, Math.round(motion.start + player.t * motion.rate));
      if (frame === this.shown) return;
      this.coming = true;
      try {
        const answer = await fetch(`${this.address()}/${frame}?camera=${encodeURIComponent(camera)}`);
        if (!answer.ok) throw new Error(await answer.text());
        const content = await answer.blob();
        if (motion === this.motion && camera === this.camera) {
          this.release();
          this.picture = URL.createObjectURL(content); this.shown = this.at = frame; this.message = "";
          window.shosa.film = { frame, camera };
        }
      } catch (error) { if (motion === this.motion) { this.message = fill(this.texts.not_loaded, { why: error.message }); this.shown = frame; } }
      this.coming = false;
      this.next();
    },
  },
};
