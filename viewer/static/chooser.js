import { fill } from "shosa";

// A recording chosen from a list that the server filters: type, arrow keys, Enter.
export default {
  template: `
  <div class="chooser">
    <input type="text" role="combobox" ref="input" :aria-expanded="open" aria-autocomplete="list" :aria-label="texts.recording" :placeholder="texts.filter" autocomplete="off" spellcheck="false"
      :value="open ? words : chosen.title" @focus="begin" @input="typed" @keydown="press" @blur="leave">
    <div class="chooser-list" v-if="open" role="listbox">
      <div v-for="(each, n) in options" :key="each.take" class="chooser-option" role="option" :data-take="each.take" :aria-selected="n===at" @pointerdown.prevent="choose(each.take)">
        <b>{{ each.title }}</b><small>{{ each.about }}</small></div>
      <div class="chooser-note" v-if="!options.length">{{ texts.none_found }}</div>
      <div class="chooser-note" v-if="more > 0">{{ say(more) }}</div>
    </div>
    <span class="chooser-drop">{{ reading || texts.drop }} · <button type="button" @click="$refs.file.click()">{{ texts.choose_file }}</button></span>
    <input type="file" ref="file" hidden accept=".bvh,.c3d,.trc" @change="send($event.target.files[0]); $event.target.value=''">
  </div>`,
  props: { chosen: Object, options: Array, more: Number, texts: Object },
  data() { return { open: false, words: "", at: 0, reading: "" }; },
  watch: { options() { this.at = 0; } },
  mounted() {
    this.over = (event) => { if ([...event.dataTransfer.types].includes("Files")) { event.preventDefault(); document.body.classList.add("dropping"); } };
    this.out = (event) => { if (!event.relatedTarget) document.body.classList.remove("dropping"); };
    this.drop = (event) => { event.preventDefault(); document.body.classList.remove("dropping"); this.send(event.dataTransfer.files[0]); };
    for (const [name, act] of [["dragover", this.over], ["dragleave", this.out], ["drop", this.drop]]) window.addEventListener(name, act);
  },
  unmounted() { for (const [name, act] of [["dragover", this.over], ["dragleave", this.out], ["drop", this.drop]]) window.removeEventListener(name, act); },
  methods: {
    async send(file) {
      if (!file) return;
      const turn = this.turn = (this.turn || 0) + 1; // what is chosen or dropped while it is read counts more
      this.reading = fill(this.texts.reading_file, { name: file.name });
      try {
        const answer = await fetch(`/files?name=${encodeURIComponent(file.name)}`, { method: "POST", body: file });
        const said = answer.ok ? await answer.json() : await answer.text();
        if (turn !== this.turn) return;
        if (answer.ok) this.$emit("file", said); else this.$emit("fault", { why: said });
      } catch (error) { if (turn === this.turn) this.$emit("fault", { why: error.message }); }
      if (turn === this.turn) this.reading = "";
    },
    say(more) { return fill(this.texts.more, { count: more.toLocaleString() }); },
    begin() { this.open = true; this.words = ""; this.at = 0; this.$emit("filter", { words: "" }); },
    typed(event) {
      this.words = event.target.value;
      clearTimeout(this.later);
      this.later = setTimeout(() => this.$emit("filter", { words: this.words }), 120);
    },
    leave() { this.open = false; },
    choose(take) { this.open = false; this.turn = (this.turn || 0) + 1; this.reading = ""; this.$refs.input.blur(); this.$emit("choose", { take }); },
    press(event) {
      const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (by) { this.at = Math.max(0, Math.min(this.options.length - 1, this.at + by)); event.preventDefault(); this.$nextTick(() => this.$el.querySelector('[aria-selected="true"]')?.scrollIntoView({ block: "nearest" })); }
      else if (event.key === "Enter" && this.options[this.at]) { event.preventDefault(); this.choose(this.options[this.at].take); }
      else if (event.key === "Escape") this.$refs.input.blur();
    },
  },
};
