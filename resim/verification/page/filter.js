"use strict";
const filters = document.querySelectorAll("button[data-verdict]");
filters.forEach(button => button.addEventListener("click", () => {
  const on = button.getAttribute("aria-pressed") !== "true";
  filters.forEach(other => other.setAttribute("aria-pressed", String(on && other === button)));
  document.querySelectorAll("tr[data-verdict], details[data-verdict]").forEach(part => {
    part.hidden = on && part.dataset.verdict !== button.dataset.verdict;
  });
}));
function openNamed() {
  const part = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!(part instanceof HTMLDetailsElement)) return;
  part.hidden = false;
  part.open = true;
  part.scrollIntoView();
}
window.addEventListener("hashchange", openNamed);
openNamed();
