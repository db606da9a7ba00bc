// Small things of every page: the state in the address, texts with places to fill.
window.shosa ||= {};

export function setAddress(state) {
  const url = new URL(window.location);
  for (const [name, value] of Object.entries(state))
    if (value === null || value === undefined || value === "") url.searchParams.delete(name);
    else url.searchParams.set(name, value);
  window.history.replaceState(window.history.state, "", url);
}
window.shosa.setAddress = setAddress;

export const fill = (text, values) => text.replace(/\{(\w+)\}/g, (all, name) => values[name] ?? all);
