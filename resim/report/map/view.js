// What part of the map is seen: view.x, view.y in the middle, view.scale in pixels per metre, view.stretch of y over x.
const canvas = document.getElementById("map"), stage = document.getElementById("stage");
let pen = canvas.getContext("2d"); // the ground may be drawn elsewhere first
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
