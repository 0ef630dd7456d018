// Lanes, borders, road marks, reference lines and junctions.
const REFERENCE = "#0b5fa5";
const MISSING = "#c51b8a", MISSING_OTHER = "#e6a6cf";
const PAINT = { standard: "#ffffff", white: "#ffffff", yellow: "#f2c230", blue: "#3f7fd0", red: "#d0463b", green: "#4a9a56", orange: "#ef8b2c", violet: "#8e5bb5" };

function trace(line, backwards = false, go = false) { // the line on from where the pen is; points within half a pixel left out
  let lastX = Infinity, lastY = Infinity;
  for (let i = 0; i < line.n; i++) {
    const k = backwards ? line.n - 1 - i : i, x = toX(line.x[k]), y = toY(line.y[k]);
    if (i > 0 && i < line.n - 1 && Math.abs(x - lastX) < 0.5 && Math.abs(y - lastY) < 0.5) continue;
    if (i === 0 && !go) pen.moveTo(x, y); else pen.lineTo(x, y);
    lastX = x; lastY = y;
  }
}

function tracePart(line, from, to) { // from one length to another
  const start = line.at(from), end = line.at(to);
  pen.moveTo(toX(start.x), toY(start.y));
  for (let k = line.segment(from) + 1; k < line.n && line.along[k] < to; k++) pen.lineTo(toX(line.x[k]), toY(line.y[k]));
  pen.lineTo(toX(end.x), toY(end.y));
}

function ring(lane) { // all rings turn the same way, so that overlaps do not cancel
  const [one, other] = lane.id < 0 ? [lane.inner, lane.outer] : [lane.outer, lane.inner];
  trace(one);
  trace(other, true, true);
  pen.closePath();
}

let STOPS = null;
const stops = () => MAP.scale.map(([at, color]) => [Math.log10(at), [1, 3, 5].map(k => parseInt(color.slice(k, k + 2), 16))]);
function errorColor(error) {
  STOPS = STOPS || stops();
  const at = Math.min(Math.max(Math.log10(Math.max(error, 1e-12)), STOPS[0][0]), STOPS[STOPS.length - 1][0]);
  const k = Math.max(STOPS.findIndex(stop => stop[0] >= at), 1), [low, a] = STOPS[k - 1], [high, b] = STOPS[k];
  const share = Math.round((8 * (at - low)) / (high - low)) / 8; // few colours: lanes of one are filled at once
  return `rgb(${a.map((v, i) => Math.round(v + share * (b[i] - v))).join(",")})`;
}

function hatched(color) {
  const tile = document.createElement("canvas");
  tile.width = tile.height = 8;
  const p = tile.getContext("2d");
  p.fillStyle = "#fff"; p.fillRect(0, 0, 8, 8);
  p.strokeStyle = color; p.lineWidth = 3.4;
  for (const k of [-8, 0, 8]) { p.beginPath(); p.moveTo(k - 2, 10); p.lineTo(k + 10, -2); p.stroke(); }
  return pen.createPattern(tile, "repeat");
}
const HATCH = { [MISSING]: hatched(MISSING), [MISSING_OTHER]: hatched(MISSING_OTHER) };

function laneColor(lane) {
  if (LOOK.lane) return LOOK.lane(lane);
  if (view.mode === "types" || !lane.error) return lane.type.color;
  if (missing(lane)) return lane.type.drivable ? MISSING : MISSING_OTHER;
  return errorColor(lane.error.worst);
}

function order(lane) { // what is drawn later lies on top
  if (view.mode === "types" || !lane.error) return lane.type.drivable ? (lane.road.junction === null ? 2 : 3) : lane.type.name === "none" ? 0 : 1;
  if (missing(lane)) return lane.type.drivable ? 2e3 : -1;
  return inexact(lane) ? 1e3 + lane.error.worst : lane.type.drivable ? 1 + lane.error.worst : lane.error.worst;
}

let sorted = {};
function lanesInOrder() {
  if (!sorted[view.mode])
    sorted[view.mode] = [...LANES].sort((a, b) => order(a) - order(b) || (laneColor(a) < laneColor(b) ? -1 : 1));
  return sorted[view.mode];
}

function drawLanes(shown) {
  let group = [], color = null;
  const least = lane => (view.mode === "error" && inexact(lane) ? 2.6 : lane.type.drivable ? 1.3 : 0);
  const flush = () => {
    if (!group.length) return;
    pen.beginPath();
    let thin = 0, wide = 0;
    for (const lane of group) {
      ring(lane);
      thin = Math.max(thin, least(lane));
      wide = Math.max(wide, lane.most);
    }
    const hatch = HATCH[color] && wide * across() > 5 && HATCH[color];
    pen.fillStyle = hatch || color;
    pen.fill();
    pen.strokeStyle = color;
    pen.lineJoin = "round";
    pen.lineWidth = Math.max(thin - wide * across(), hatch ? 1 : 0.6); // closes the seams between neighbours
    pen.stroke();
    group = [];
  };
  for (const lane of lanesInOrder()) {
    if (!shown.has(lane)) continue;
    const own = laneColor(lane);
    if (own !== color || group.length === 24) { flush(); color = own; } // large paths fill slowly
    group.push(lane);
  }
  flush();
}

function strokeLines(lines, color, width) {
  pen.strokeStyle = color;
  pen.lineWidth = width;
  pen.beginPath();
  for (const line of lines) trace(line);
  pen.stroke();
}

function dashes(kind) { // of one stroke, in pixels
  if (kind === "broken") return [3, 4.5].map((m, i) => Math.max(m * view.scale, i ? 7 : 6));
  if (kind === "dots") return [1, Math.max(view.scale, 4)];
  return [];
}

function strokeMark(line, from, to, kind, color, width) {
  for (const [a, b] of seen(line, 40)) {
    const start = Math.max(a, from), end = Math.min(b, to);
    if (end <= start) continue;
    pen.beginPath();
    tracePart(line, start, end);
    pen.setLineDash(dashes(kind));
    pen.lineDashOffset = (start - from) * view.scale;
    pen.strokeStyle = LOOK.markEdge;
    pen.lineWidth = width + 1.1;
    if (kind !== "curb") pen.stroke();
    pen.strokeStyle = color;
    pen.lineWidth = width;
    pen.stroke();
  }
  pen.setLineDash([]);
}

function drawMarks(bounds) {
  pen.lineCap = "butt";
  pen.globalAlpha = LOOK.marks;
  for (const mark of MARKS) {
    if (!meets(mark.line.box, bounds)) continue;
    const from = mark.line.along[mark.first], to = mark.line.along[mark.last];
    const color = mark.kind === "curb" ? "#4a525c" : mark.kind === "grass" ? "#7da05a" : PAINT[mark.color] || "#ffffff";
    const width = Math.min(Math.max(mark.width * across(), 1.1), 14), strokes = mark.kind.split(" ");
    const kinds = strokes.map(kind => (kind === "botts" ? "dots" : kind === "broken" || kind === "curb" ? kind : "solid"));
    if (kinds.length === 1 || mark.kind === "botts dots") { strokeMark(mark.line, from, to, kinds[0], color, width); continue; }
    mark.pair = mark.pair || [mark.line.beside(0.12), mark.line.beside(-0.12)];
    kinds.slice(0, 2).forEach((kind, i) => {
      const line = mark.pair[i];
      strokeMark(line, line.along[mark.first], line.along[mark.last], kind, color, Math.min(width, 0.12 * across()));
    });
  }
  pen.globalAlpha = 1;
}

function drawReference(bounds) { // dotted, so that a road mark below is seen
  const roads = ROADS.filter(road => meets(road.box, bounds)), period = 5 / view.scale;
  pen.beginPath();
  for (const { line } of roads)
    for (const [from, to] of seen(line, 20)) tracePart(line, Math.floor(from / period) * period, to);
  pen.strokeStyle = view.mode === "types" ? REFERENCE : "rgba(29,39,51,.75)";
  pen.lineWidth = view.scale > 6 ? 1.8 : 1.4;
  pen.setLineDash([2, 3]);
  pen.stroke();
  pen.setLineDash([]);
  pen.fillStyle = view.mode === "types" ? REFERENCE : "rgba(29,39,51,.7)";
  for (const road of view.scale > 2.5 ? roads : []) { // a dot where s is 0
    pen.beginPath();
    pen.arc(toX(road.line.x[0]), toY(road.line.y[0]), view.scale > 6 ? 3.2 : 2, 0, 7);
    pen.fill();
  }
}

function drawJunctions(bounds) {
  pen.beginPath();
  for (const junction of JUNCTIONS)
    if (meets(junction.box, bounds)) for (const line of junction.rings) { trace(line); pen.closePath(); }
  pen.fillStyle = LOOK.junction;
  pen.fill();
  pen.strokeStyle = LOOK.junctionEdge;
  pen.lineWidth = 1;
  pen.stroke();
}
