// Dark and light: what the system has, until the button says otherwise.

import { byId, forgetColours } from "./dom.js";
import { changed } from "./state.js";

const dark = matchMedia("(prefers-color-scheme: dark)");
const root = document.documentElement;

export const isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : dark.matches);

function change() {
  forgetColours();
  changed("theme");
}

export function startTheme() {
  const kept = localStorage.getItem("theme");
  if (kept) root.dataset.theme = kept;
  dark.addEventListener("change", change);
  byId("theme").addEventListener("click", () => {
    root.dataset.theme = isDark() ? "light" : "dark";
    localStorage.setItem("theme", root.dataset.theme);
    change();
  });
}
