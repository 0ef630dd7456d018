// A distance on the map, measured by a drag or by two taps.
const ruler = { on: false, half: false, ends: null };
const mapPlace = (px, py) => ({ x: fromX(px), y: fromY(py) });

function setRuler(on) {
  Object.assign(ruler, { on, half: false, ends: null });
  canvas.classList.toggle("measuring", on);
  redraw();
}

function pressRuler(px, py) { // whether it takes the drag
  if (ruler.on && !ruler.half) ruler.ends = { a: mapPlace(px, py), b: mapPlace(px, py) };
  return ruler.on;
}

function dragRuler(px, py) {
  ruler.ends.b = mapPlace(px, py);
  ruler.half = false;
  redraw();
}

function tapRuler(px, py) {
  if (ruler.half) ruler.ends.b = mapPlace(px, py);
  ruler.half = !ruler.half;
  redraw();
}

function drawRuler() {
  if (!ruler.ends) return;
  const { a, b } = ruler.ends, far = Math.hypot(a.x - b.x, a.y - b.y);
  stage.dataset.measured = far.toFixed(2);
  bar([[toX(a.x), toY(a.y)], [toX(b.x), toY(b.y)]]);
  for (const p of [a, b]) { pen.beginPath(); pen.arc(toX(p.x), toY(p.y), 4, 0, 7); pen.fillStyle = LOOK.ink; pen.fill(); }
  if (far > 0) haloed(`${far.toFixed(2)} m`, (toX(a.x) + toX(b.x)) / 2, (toY(a.y) + toY(b.y)) / 2 - 12, "center", 14);
}
