// Below the scene: marks on the time line, and the curves of risk, TTC, speed and acceleration.
const chart = document.getElementById("curves"), cursor = document.getElementById("cursor");
const KINDS = { finding: "findings", criterion: "criteria", decision: "decisions", reaction: "reactions", collision: "collisions", end: "ends" };
const LEFT = 80, RIGHT = 10, LANE = 20, ROW = 62;
let sheetOf = "", chartWidth = 0; // px; asking the page for it at every frame would cost more than the frame

const chartX = t => LEFT + ((t - play.from) / Math.max(play.to - play.from, 1e-9)) * (chartWidth - LEFT - RIGHT);
const chartT = px => play.from + ((px - LEFT) / Math.max(chartWidth - LEFT - RIGHT, 1)) * (play.to - play.from);
const lanesOfMarks = () => Object.keys(KINDS).filter(kind => play.drive.marks.some(mark => mark.kind === kind));

function rowsOfCurves() {
  const shown = visible(), rows = [];
  const dangers = shown.filter(layer => layer.danger);
  if (dangers.length) {
    rows.push({ name: "risk", unit: "", zero: true, lines: dangers.map(l => ({ layer: l, t: l.danger.t, v: l.danger.risk })) });
    rows.push({ name: "TTC", unit: "s", zero: true, most: 8, lines: dangers.map(l => ({ layer: l, t: l.danger.t, v: l.danger.ttc })) });
  }
  rows.push({ name: "speed", unit: "m/s", lines: shown.filter(l => l.ego).map(l => ({ layer: l, t: l.ego.t, v: l.ego.v })) });
  rows.push({ name: "accel.", unit: "m/s²", cross: true, lines: shown.filter(l => l.acceleration).map(l => ({ layer: l, t: l.acceleration.t, v: l.acceleration.a })) });
  return rows.filter(row => row.lines.length);
}

function range(row) {
  let low = row.zero || row.cross ? 0 : Infinity, high = row.zero || row.cross ? 0 : -Infinity;
  for (const { v } of row.lines) for (const value of v) if (value !== null && isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); }
  if (!(high >= low)) [low, high] = [0, 1];
  if (row.most) high = row.most;
  const least = row.name === "risk" ? 0.001 : 1;
  if (high - low < least) high = low + least;
  const pad = row.zero ? 0 : 0.06 * (high - low);
  return [low - pad, high + 0.06 * (high - low)];
}

function paintCurves(w, h, dots) {
  chart.width = Math.round(w * dots);
  chart.height = Math.round(h * dots);
  const p = chart.getContext("2d");
  p.setTransform(dots, 0, 0, dots, 0, 0);
  p.clearRect(0, 0, w, h);
  p.textBaseline = "middle";
  let top = 4;
  for (const kind of lanesOfMarks()) {
    text(p, KINDS[kind], LEFT - 6, top + LANE / 2, "right", LOOK.text, 11);
    p.fillStyle = LOOK.grid;
    p.fillRect(LEFT, top + LANE / 2 - 0.5, w - LEFT - RIGHT, 1);
    for (const mark of play.drive.marks) if (mark.kind === kind) paintMark(p, mark, top + LANE / 2);
    top += LANE;
  }
  for (const row of rowsOfCurves()) { paintRow(p, row, top, w); top += ROW; }
  paintTimes(p, top, w);
}

function text(p, words, x, y, align, color, size) {
  p.font = `${size}px ${FONT}`;
  p.textAlign = align;
  p.fillStyle = color;
  p.fillText(words, x, y);
}

function markColor(mark) {
  if (mark.kind === "collision" || mark.kind === "end") return tone(CRITICAL);
  if (mark.kind === "finding" || mark.kind === "criterion") return mark.text.startsWith("error") ? tone(CRITICAL) : dark() ? "#f2c14e" : "#8a5a00";
  const layer = play.layers.find(l => l.name === mark.source);
  return layer ? tone(layer.colors.ego) : LOOK.ink;
}

function paintMark(p, mark, y) {
  const x = chartX(mark.start), end = chartX(mark.end), color = markColor(mark);
  p.fillStyle = p.strokeStyle = color;
  if (end - x > 2) { p.globalAlpha = 0.45; p.fillRect(x, y - 2, end - x, 4); p.globalAlpha = 1; }
  p.beginPath();
  if (mark.kind === "collision") { p.lineWidth = 2.4; p.moveTo(x - 5, y - 5); p.lineTo(x + 5, y + 5); p.moveTo(x + 5, y - 5); p.lineTo(x - 5, y + 5); p.stroke(); return; }
  if (mark.kind === "finding") { p.moveTo(x, y - 6); p.lineTo(x + 5.5, y + 5); p.lineTo(x - 5.5, y + 5); }
  else if (mark.kind === "criterion") { p.moveTo(x, y + 6); p.lineTo(x + 5.5, y - 5); p.lineTo(x - 5.5, y - 5); }
  else if (mark.kind === "decision") { p.moveTo(x, y - 6); p.lineTo(x + 6, y); p.lineTo(x, y + 6); p.lineTo(x - 6, y); }
  else if (mark.kind === "end") p.rect(x - 4.5, y - 4.5, 9, 9);
  else p.arc(x, y, 5, 0, 7);
  p.closePath();
  if (mark.source.startsWith("r")) { p.lineWidth = 2; p.stroke(); } else p.fill(); // hollow: re-simulated
}

function paintRow(p, row, top, w) {
  const [low, high] = range(row), inner = ROW - 12, at = v => top + 6 + inner * (1 - (v - low) / (high - low));
  const ticks = nice((high - low) / 2.5), digits = Math.max(0, -Math.floor(Math.log10(ticks) + 1e-9));
  text(p, row.name, 4, top + 13, "left", LOOK.ink, 11.5);
  text(p, row.unit, 4, top + 28, "left", LOOK.text, 11);
  for (let k = Math.ceil(low / ticks - 1e-9); k * ticks <= high; k++) {
    const y = Math.round(at(k * ticks));
    p.fillStyle = k === 0 ? LOOK.border : LOOK.grid;
    p.fillRect(LEFT, y, w - LEFT - RIGHT, 1);
    text(p, minus((k * ticks).toFixed(digits)), LEFT - 6, y, "right", LOOK.text, 11);
  }
  p.save();
  p.beginPath();
  p.rect(LEFT, top + 2, w - LEFT - RIGHT, ROW - 4);
  p.clip();
  for (const line of row.lines) paintLine(p, line, at);
  p.restore();
}

function paintLine(p, { layer, t, v }, at) { // as fine as a pixel: of each column the first, least, largest
  p.beginPath();
  let drawn = false, column = null, low = 0, high = 0;
  for (let k = 0; k < t.length; k++) {
    if (v[k] === null || !isFinite(v[k])) { drawn = false; continue; }
    const x = chartX(t[k]), y = at(v[k]);
    if (drawn && t.length > 3000 && Math.floor(x) === column) {
      if (y < low) p.lineTo(x, (low = y)); else if (y > high) p.lineTo(x, (high = y));
      continue;
    }
    if (drawn) p.lineTo(x, y); else p.moveTo(x, y);
    if (!drawn && (k + 1 >= t.length || v[k + 1] === null)) p.lineTo(x + 1, y);
    [drawn, column, low, high] = [true, Math.floor(x), y, y];
  }
  p.strokeStyle = tone(layer.colors.ego);
  p.lineWidth = 1.7;
  p.setLineDash(layer.colors.dash);
  p.stroke();
  p.setLineDash([]);
}

function paintTimes(p, top, w) {
  const ticks_ = nice(((play.to - play.from) * 62) / Math.max(w - LEFT - RIGHT, 62)), digits = Math.max(0, -Math.floor(Math.log10(ticks_) + 1e-9));
  for (let k = Math.ceil(play.from / ticks_ - 1e-9); k * ticks_ <= play.to + 1e-9; k++) {
    const x = chartX(k * ticks_);
    p.fillStyle = LOOK.text;
    p.fillRect(Math.round(x), top, 1, 4);
    if (x < w - 48) text(p, minus((k * ticks_).toFixed(digits)), x, top + 12, "center", LOOK.text, 11);
  }
  text(p, "t [s]", w - 4, top + 12, "right", LOOK.text, 11);
}

function drawCurves() { // drawn anew only where something else is to be seen; a line moves over it
  const dots = window.devicePixelRatio || 1, w = chartWidth;
  if (!w) return;
  const of = `${play.number} ${w} ${dots} ${dark()} ${play.layers.map(layer => Number(layer.shown)).join("")}`;
  if (of !== sheetOf) {
    const h = 4 + LANE * lanesOfMarks().length + ROW * rowsOfCurves().length + 22;
    chart.style.height = `${h}px`;
    cursor.style.height = `${h - 18}px`;
    cursor.style.background = tone(CRITICAL);
    paintCurves(w, h, dots);
    sheetOf = of;
  }
  cursor.style.transform = `translateX(${chartX(play.t) - 0.75}px)`;
}

function markAt(px, py) { // the mark under a place on the chart
  const kinds = lanesOfMarks(), kind = kinds[Math.floor((py - 4) / LANE)];
  const near = play.drive.marks.filter(mark => mark.kind === kind).map(mark => [Math.abs(chartX(mark.start) - px), mark]);
  near.sort((a, b) => a[0] - b[0]);
  return near.length && near[0][0] < 12 ? near[0][1] : null;
}
