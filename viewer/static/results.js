import { fill } from "shosa";

// The matches of a search, the nearest first: one button each; arrow keys go to the next. While it
// goes on they are those until now, of which the open ones may still go; none can be chosen yet.
export default {
  template: `
  <div class="results" role="listbox" :aria-label="texts.results" :aria-busy="searching" tabindex="0" @keydown="press">
    <button v-for="m in matches" :key="m.rank" class="result" :class="{open: m.open}" role="option" tabindex="-1" :data-rank="m.rank" :aria-selected="m.rank===chosen" @click="choose(m.rank)">
      <span class="rank">{{ m.rank }}</span>
      <svg class="poses" viewBox="0 0 96 40" aria-hidden="true"><path :d="m.strip"></path></svg>
      <span class="what"><b>{{ m.title }}</b><small>{{ m.performer }}<template v-if="m.mirrored"> · {{ texts.mirrored }}</template></small><small>{{ m.first }}–{{ m.last }} · {{ m.seconds }} s</small></span>
      <span class="far"><i :style="{width: m.share + '%'}"></i>{{ m.distance }}<small v-if="m.level" :title="texts['level_' + m.level + '_title']">{{ texts['level_' + m.level] }}</small><small v-if="m.chance" :title="texts.chance_title">{{ m.chance }}</small></span>
    </button>
  </div>`,
  props: { matches: Array, chosen: Number, searching: Boolean, texts: Object },
  watch: { chosen() { this.$nextTick(() => this.$el.querySelector('[aria-selected="true"]')?.scrollIntoView({ block: "nearest" })); } },
  mounted() {
    this.key = (event) => { // up and down go from match to match wherever nothing else wants them
      if (!["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName) && !event.target.closest?.("[role=slider],[role=listbox],[role=combobox]")) this.press(event);
    };
    window.addEventListener("keydown", this.key);
  },
  unmounted() { window.removeEventListener("keydown", this.key); },
  methods: {
    choose(rank) { if (rank !== this.chosen && !this.searching) this.$emit("choose", { rank }); },
    press(event) {
      const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (!by || !this.matches.length) return;
      event.preventDefault();
      this.choose(Math.max(1, Math.min(this.matches.length, (this.chosen || 0) + by)));
    },
  },
};
