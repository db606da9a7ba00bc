// The recordings that are listed: one button each; arrow keys go to the next.
export default {
  template: `
  <div class="takes" role="listbox" :aria-label="texts.recording" tabindex="0" @keydown="press">
    <button v-for="t in takes" :key="t.take" class="take" role="option" tabindex="-1" :data-take="t.take" :aria-selected="t.take===chosen" @click="choose(t.take)">
      <svg class="poses" viewBox="0 0 96 40" aria-hidden="true"><path :d="t.strip"></path></svg>
      <span class="what"><b>{{ t.title }}</b><small>{{ t.performer }}{{ t.performer ? " · " : "" }}{{ t.take }}</small></span>
      <span class="has">{{ t.seconds }} s<br>{{ t.kind }}</span>
    </button>
  </div>`,
  props: { takes: Array, chosen: String, texts: Object },
  methods: {
    choose(take) { if (take !== this.chosen) this.$emit("choose", { take }); },
    press(event) {
      const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (!by) return;
      event.preventDefault();
      const at = this.takes.findIndex((each) => each.take === this.chosen), next = this.takes[Math.max(0, Math.min(this.takes.length - 1, at + by))];
      if (next) this.choose(next.take);
    },
  },
};
