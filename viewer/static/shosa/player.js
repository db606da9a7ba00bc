// The clock that the stage, the slider and the cursors of the curves go by.
const listeners = new Set();
let last = 0;

export const player = {
  t: 0, length: 1, rate: 30, playing: false, speed: 1, loop: true,
  on(listener) { listeners.add(listener); return () => listeners.delete(listener); },
  tell() { for (const listener of listeners) listener(this); },
  setLength(seconds, rate) { this.length = Math.max(seconds, 1e-3); this.rate = rate; this.seek(0); },
  seek(t) { this.t = Math.max(0, Math.min(this.length, t)); this.tell(); },
  step(frames) { this.playing = false; this.seek((Math.round(this.t * this.rate) + frames) / this.rate); },
  toggle() { this.playing = !this.playing; if (this.playing && this.t >= this.length) this.t = 0; this.tell(); },
  tick(now) {
    const passed = Math.min(0.25, (now - last) / 1000); // a tab that slept goes on where it was
    last = now;
    if (!this.playing) return;
    let t = this.t + passed * this.speed;
    if (t >= this.length) { t = this.loop ? t % this.length : this.length; if (!this.loop) this.playing = false; }
    this.t = t;
    this.tell();
  },
};
