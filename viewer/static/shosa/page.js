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

// Save what an address answers as a file; what it says is wrong stands on top of the page.
export async function save(address, wrong) {
  const notice = document.querySelector(".notice");
  document.body.classList.add("saving");
  try {
    const answer = await fetch(address);
    if (!answer.ok) throw new Error(await answer.text());
    const named = /filename\*=UTF-8''(.*)$/.exec(answer.headers.get("content-disposition") || "");
    const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(await answer.blob()), download: named ? decodeURIComponent(named[1]) : "" });
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 60000); // the browser reads it in its own time
    notice?.classList.add("empty");
  } catch (error) {
    if (notice) { notice.textContent = fill(wrong, { why: error.message }); notice.classList.remove("empty"); }
  }
  document.body.classList.remove("saving");
}
