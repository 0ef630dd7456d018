// What is around and below the lanes: grid, coordinates, scale bar, north; and the ground, which all is drawn on.
function gridStep(scale) { return nice(95 / scale); }

function drawGrid() {
  pen.strokeStyle = LOOK.grid;
  pen.lineWidth = 1;
  pen.beginPath();
  for (const [px] of ticksX()) { pen.moveTo(Math.round(px) + 0.5, 0); pen.lineTo(Math.round(px) + 0.5, view.height); }
  for (const [py] of ticksY()) { pen.moveTo(0, Math.round(py) + 0.5); pen.lineTo(view.width, Math.round(py) + 0.5); }
  pen.stroke();
}

function ticks(from, to, scale, origin, place) {
  const step = gridStep(scale), digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9)), out = [];
  for (let k = Math.ceil((from + origin) / step); k * step <= to + origin; k++)
    out.push([place(k * step - origin), minus((k * step).toFixed(digits))]);
  return out;
}
const ticksX = () => ticks(fromX(0), fromX(view.width), sx(), MAP.origin[0], toX);
const ticksY = () => ticks(fromY(view.height), fromY(0), sy(), MAP.origin[1], toY);

function haloed(text, x, y, align, size = 11) {
  pen.font = `${size}px ${FONT}`;
  pen.textAlign = align; pen.textBaseline = "middle"; pen.lineJoin = "round";
  pen.strokeStyle = LOOK.halo; pen.lineWidth = 3.5; pen.strokeText(text, x, y);
  pen.fillStyle = LOOK.text; pen.fillText(text, x, y);
}

function drawAxes() {
  pen.fillStyle = LOOK.band;
  pen.fillRect(0, view.height - 19, view.width, 19);
  for (const [px, text] of ticksX()) if (px > 66 && px < view.width - 52) haloed(text, px, view.height - 9, "center");
  for (const [py, text] of ticksY()) if (py > 24 && py < view.height - (view.stretch === 1 ? 66 : 150)) haloed(text, 5, py, "left");
  haloed("x [m]", view.width - 6, view.height - 9, "right");
  haloed("y [m]", 5, 11, "left");
}

const length_ = m => (m >= 1000 ? `${m / 1000} km` : m >= 1 ? `${m} m` : `${Math.round(100 * m)} cm`);

function scaleBar() {
  const m = nice(140 / sx(), true), w = m * sx(), x = 14, y = view.height - 32;
  bar([[x, y - 5], [x, y], [x + w, y], [x + w, y - 5]]);
  haloed(length_(m), x + w / 2, y - 9, "center", 12);
  if (view.stretch === 1) return;
  const n = nice(90 / sy(), true), h = n * sy();
  bar([[x + 5, y - h - 26], [x, y - h - 26], [x, y - 26], [x + 5, y - 26]]);
  haloed(length_(n), x + 9, y - 26 - h / 2, "left", 12);
}

function bar(points) {
  for (const [color, width] of [[LOOK.halo, 5], [LOOK.ink, 2]]) {
    pen.beginPath();
    points.forEach((p, k) => (k ? pen.lineTo(...p) : pen.moveTo(...p)));
    pen.strokeStyle = color; pen.lineWidth = width; pen.stroke();
  }
}

function north() {
  const x = view.width - 18, y = 34;
  pen.beginPath();
  pen.moveTo(x, y - 14); pen.lineTo(x + 6, y + 6); pen.lineTo(x, y + 2); pen.lineTo(x - 6, y + 6); pen.closePath();
  pen.strokeStyle = LOOK.halo; pen.lineWidth = 4; pen.stroke();
  pen.fillStyle = LOOK.ink; pen.fill();
  haloed("N", x, y - 22, "center", 11);
}

function drawGround(bounds, shown) { // paper, grid, and the lanes that are shown
  pen.fillStyle = LOOK.paper;
  pen.fillRect(0, 0, view.width, view.height);
  drawGrid();
  drawJunctions(bounds);
  drawLanes(shown);
  if (across() > 1.7) strokeLines(LINES.filter(line => meets(line.box, bounds)), LOOK.border, 0.7);
  if (across() > 1.8) drawMarks(bounds);
}
