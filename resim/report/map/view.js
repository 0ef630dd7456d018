// What part of the map is seen: view.x, view.y in the middle, view.scale in pixels per metre, view.stretch of y over x.
const canvas = document.getElementById("map"), stage = document.getElementById("stage");
const pen = canvas.getContext("2d");
const view = { x: 0, y: 0, scale: 1, stretch: 1, width: 0, height: 0, mode: "types", chosen: null, moved: false };
const CLOSEST = 500; // px per m
const THIN = 10; // from so many times longer than wide on, a map can be stretched

const sx = () => view.scale, sy = () => view.scale * view.stretch;
const toX = x => view.width / 2 + (x - view.x) * sx();
const toY = y => view.height / 2 - (y - view.y) * sy();
const fromX = px => view.x + (px - view.width / 2) / sx();
const fromY = py => view.y - (py - view.height / 2) / sy();
const across = () => Math.max(sx(), sy()); // px per m across a road: where stretched, roads lie along the other axis

function window_(pad = 0) { // what is seen, in metres
  return [fromX(-pad), fromY(view.height + pad), fromX(view.width + pad), fromY(-pad)];
}
const meets = (a, b) => a[0] <= b[2] && a[2] >= b[0] && a[1] <= b[3] && a[3] >= b[1];

let waiting = false;
function redraw() {
  if (waiting) return;
  waiting = true;
  requestAnimationFrame(() => { waiting = false; draw(); });
}

function fit(box, least = 0, border = 0.05) { // show a box, at least so many metres wide
  const w = Math.max(box[2] - box[0], least, 1), h = Math.max(box[3] - box[1], least * 0.5, 1);
  const room = 1 - 2 * border;
  view.scale = Math.min((view.width * room) / w, (Math.max(view.height - 60, 80) * room) / (h * view.stretch), CLOSEST);
  view.x = (box[0] + box[2]) / 2;
  view.y = (box[1] + box[3]) / 2;
  redraw();
}

function zoom(factor, px = view.width / 2, py = view.height / 2) {
  const x = fromX(px), y = fromY(py);
  const whole = Math.min(view.width / (WHOLE[2] - WHOLE[0] + 1), view.height / ((WHOLE[3] - WHOLE[1] + 1) * view.stretch));
  view.scale = Math.min(Math.max(view.scale * factor, whole / 3), CLOSEST);
  view.x += x - fromX(px);
  view.y += y - fromY(py);
  changed();
}

function move(dx, dy) {
  view.x -= dx / sx();
  view.y += dy / sy();
  changed();
}

let later = 0;
function changed() {
  view.moved = true;
  redraw();
  clearTimeout(later);
  later = setTimeout(writeAddress, 250);
}

function whole() {
  fit(WHOLE);
  view.moved = false;
  writeAddress();
}

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

function nice(value, down = false) { // the next of 1, 2, 5, 10 ... up (or down)
  const power = 10 ** Math.floor(Math.log10(value)), steps = [1, 2, 5, 10];
  return power * (down ? steps.filter(s => s * power <= value * 1.0001).pop() : steps.find(s => s * power >= value * 0.9999));
}

function seen(line, pad = 0) { // the lengths [from, to] of the line between which it is in view
  const [x0, y0, x1, y1] = window_(pad), runs = [];
  for (let k = 0; k + 1 < line.n; k++) {
    const x = line.x[k], y = line.y[k], dx = line.x[k + 1] - x, dy = line.y[k + 1] - y;
    let from = 0, to = 1;
    for (const [p, q] of [[-dx, x - x0], [dx, x1 - x], [-dy, y - y0], [dy, y1 - y]]) {
      if (p === 0) { if (q < 0) to = -1; } else if (p < 0) from = Math.max(from, q / p); else to = Math.min(to, q / p);
    }
    if (from >= to) continue;
    const start = line.along[k], step = line.along[k + 1] - start, last = runs[runs.length - 1];
    if (last && last[1] >= start + from * step - 1e-6) last[1] = start + to * step;
    else runs.push([start + from * step, start + to * step]);
  }
  return runs;
}
