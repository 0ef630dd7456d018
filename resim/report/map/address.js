// The address of the page, which holds the view; colours of the lanes; a long thin map stretched.
function writeAddress() {
  const parts = [];
  if (view.moved) {
    const width = view.width / view.scale, digits = width < 200 ? 2 : 0;
    parts.push(`x=${(view.x + MAP.origin[0]).toFixed(digits)}`, `y=${(view.y + MAP.origin[1]).toFixed(digits)}`, `w=${width.toPrecision(4)}`);
  }
  if (view.mode !== "types") parts.push(`mode=${view.mode}`);
  if (view.stretch !== 1) parts.push(`stretch=${view.stretch}`);
  try {
    history.replaceState(null, "", parts.length ? "#" + parts.join("&") : location.pathname + location.search);
  } catch { /* a page that was opened from a file may not set its address */ }
}

function readAddress() {
  const asked = new URLSearchParams(location.hash.slice(1)), value = name => parseFloat(asked.get(name));
  setStretch(value("stretch") > 0 ? value("stretch") : 1);
  setMode(asked.get("mode") === "error" ? "error" : "types");
  if (!(value("w") > 0)) { fit(WHOLE); return; }
  view.scale = Math.min(view.width / value("w"), CLOSEST);
  if (isFinite(value("x"))) view.x = value("x") - MAP.origin[0];
  if (isFinite(value("y"))) view.y = value("y") - MAP.origin[1];
  view.moved = true;
  redraw();
}

function setMode(mode) {
  view.mode = mode === "error" && MAP.errors ? "error" : "types";
  for (const button of document.querySelectorAll("[data-mode]"))
    button.setAttribute("aria-pressed", String(button.dataset.mode === view.mode));
  document.getElementById("key-types").hidden = view.mode !== "types";
  const key = document.getElementById("key-error");
  if (key) key.hidden = view.mode !== "error";
  redraw();
}

function bestStretch() { // 1, 2, 5, 10 ... over which a long thin map fills the picture; 1 where that is not much
  const w = WHOLE[2] - WHOLE[0] + 1, h = WHOLE[3] - WHOLE[1] + 1, shape = view.height / view.width;
  if (Math.max(w / h, h / w) < THIN) return 1;
  const round = nice(0.7 * (w > h ? (w / h) * shape : h / w / shape), true);
  return round < 4 ? 1 : w > h ? round : 1 / round;
}

function setStretch(value) {
  view.stretch = value;
  const button = document.getElementById("stretch"), best = value !== 1 ? value : bestStretch();
  button.hidden = best === 1;
  button.setAttribute("aria-pressed", String(value !== 1));
  button.textContent = best >= 1 ? `Stretch y × ${best}` : `Stretch x × ${Math.round(1 / best)}`;
}
