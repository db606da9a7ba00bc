// Light or dark, and the language: kept by the browser.
addEventListener("DOMContentLoaded", () => {
  const set = () => (window.Quasar ? Quasar.Dark.set(localStorage.theme === "dark") : setTimeout(set, 20));
  if (localStorage.theme) set();
});

function nextTheme() {
  const dark = document.body.classList.contains("body--dark");
  localStorage.theme = dark ? "light" : "dark";
  Quasar.Dark.set(!dark);
}

function setLanguage(code) {
  document.cookie = `language=${code};path=/;max-age=31536000;samesite=strict`;
  const url = new URL(location);
  url.searchParams.delete("lang");
  location.replace(url);
}
