// Ids, arrows and markers: drawn where there is room on the screen, what matters more first.
function pill(text, x, y, { fill = LOOK.paper, edge = LOOK.text, ink = LOOK.ink, size = 11, pad = 4 } = {}) {
  pen.font = `600 ${size}px ${FONT}`;
  const w = pen.measureText(text).width + 9, h = size + 5;
  if (!free(x, y, w, h, pad)) return false;
  pen.beginPath();
  pen.rect(Math.round(x - w / 2) + 0.5, Math.round(y - h / 2) + 0.5, Math.round(w), h);
  pen.fillStyle = fill; pen.fill();
  pen.strokeStyle = edge; pen.lineWidth = 1; pen.stroke();
  pen.fillStyle = ink; pen.textAlign = "center"; pen.textBaseline = "middle";
  pen.fillText(text, x, y + 1);
  return true;
}

function bare(text, x, y, size) {
  pen.font = `600 ${size}px ${FONT}`;
  if (!free(x, y, pen.measureText(text).width, size, 1.5)) return false;
  pen.textAlign = "center"; pen.textBaseline = "middle"; pen.lineJoin = "round";
  pen.strokeStyle = "rgba(255,255,255,.85)"; pen.lineWidth = 3; pen.strokeText(text, x, y); // lanes have their colours on either paper
  pen.fillStyle = LIGHT.ink; pen.fillText(text, x, y + 0.5);
  return true;
}

function longest(line) { // the longest stretch in view
  return seen(line).reduce((best, run) => (run[1] - run[0] > best[1] - best[0] ? run : best), [0, 0]);
}

function along(line, places, least, put) { // try places (shares) on the longest stretch in view
  const [from, to] = longest(line), a = line.at(from), b = line.at(to);
  const size = Math.max(Math.hypot(toX(a.x) - toX(b.x), toY(a.y) - toY(b.y)), (to - from) * view.scale * 0.5);
  if (!(to > from) || size < least) return;
  for (const share of places) {
    const place = line.at(from + share * (to - from));
    if (put(toX(place.x), toY(place.y))) return;
  }
}

function junctionLabels(bounds) {
  const size = j => Math.max((j.box[2] - j.box[0]) * sx(), (j.box[3] - j.box[1]) * sy());
  for (const junction of JUNCTIONS.filter(j => meets(j.box, bounds)).sort((a, b) => size(b) - size(a))) {
    if (size(junction) < 7) continue;
    const type = view.scale > 2 && junction.type !== "default" ? ` (${junction.type})` : "";
    const style = { fill: "#6b4a94", edge: "#6b4a94", ink: "#fff", pad: size(junction) > 60 ? 3 : 7 };
    const ring = junction.rings[0], x = toX((ring.box[0] + ring.box[2]) / 2), top = toY(ring.box[3]) - 10;
    const text = `J ${short(junction.id)}${type}`, inside = Math.min(Math.max(x, 70), view.width - 70);
    pill(text, x, top, style) || pill(text, inside, Math.max(top, 14), style) || pill(text, x, toY(ring.box[1]) + 10, style);
  }
}

function roadLabels(bounds) {
  const sections = view.scale > 3;
  const parts = ROADS.filter(road => meets(road.box, bounds)).flatMap(road =>
    sections && road.sections > 1 ? road.parts.map(part => ({ ...part, text: `${short(road.id)} §${part.section}` }))
      : [{ road, line: road.line, text: short(road.id) }]);
  parts.sort((a, b) => (a.road.junction === null ? 0 : 1) - (b.road.junction === null ? 0 : 1) || b.line.length - a.line.length);
  for (const { road, line, text } of parts) {
    const inside = road.junction !== null;
    along(line, inside ? [0.5, 0.35, 0.65, 0.2, 0.8] : [0.5, 0.3, 0.7], inside ? 46 : sections ? 24 : 16, (x, y) =>
      pill(text, x, y, { pad: sections ? 2 : 6, edge: inside ? LOOK.junctionEdge : LOOK.text }));
  }
}

function laneLabels(shown) {
  const covered = (x, y) => shown.some(lane => lane.type.drivable && holds(lane, x, y));
  for (const lane of shown) {
    const wide = lane.most * across();
    if (wide < 11) continue;
    const size = Math.min(Math.max(Math.round(wide * 0.34), 10), 15), inside = lane.road.junction !== null;
    along(lane.centre, inside ? [0.5, 0.3, 0.7] : [0.44, 0.56, 0.25, 0.75], 18, (x, y) =>
      (!inside || lane.type.drivable || !covered(fromX(x), fromY(y))) && bare(minus(lane.id), x, y, size));
  }
}

function arrows(shown) {
  const spacing = 2 ** Math.ceil(Math.log2(120 / view.scale)), line_ = lane => lane.centre;
  pen.strokeStyle = pen.fillStyle = "rgba(29,39,51,.62)";
  pen.lineWidth = 1.6; pen.lineCap = "round";
  for (const lane of shown) {
    const wide = lane.most * across();
    if (!lane.way || wide < 9) continue;
    const line = line_(lane), size = Math.min(Math.max(wide * 0.42, 8), 18);
    for (const [from, to] of seen(line)) {
      const places = [];
      if (line.length < spacing) places.push(line.length * (lane.way < 0 ? 0.3 : 0.7));
      else for (let d = (Math.floor(from / spacing) + 0.25) * spacing; d < to; d += spacing) if (d > from) places.push(d);
      for (const d of places) if (line.length * view.scale > 26) arrow(line.at(d), lane.way, size);
    }
  }
  pen.lineCap = "butt";
}

function arrow(place, way, size) {
  const x = toX(place.x), y = toY(place.y), angle = Math.atan2(-place.dy * sy(), place.dx * sx()) + (way < 0 ? Math.PI : 0);
  if (!free(x, y, size, size, 1)) return;
  const c = Math.cos(angle), s = Math.sin(angle), at = (u, v) => [x + u * c - v * s, y + u * s + v * c];
  for (const turn of way === 2 ? [1, -1] : [1]) {
    pen.beginPath();
    pen.moveTo(...at(-size / 2 * turn, 0)); pen.lineTo(...at(size / 2 * turn, 0));
    pen.moveTo(...at(size / 5 * turn, -size / 4)); pen.lineTo(...at(size / 2 * turn, 0)); pen.lineTo(...at(size / 5 * turn, size / 4));
    pen.stroke();
  }
}

const metres = v => (v === null ? "–" : v >= 1 ? `${v.toFixed(2)} m` : `${(1000 * v).toFixed(2)} mm`);
const rough = v => (v >= 0.995 ? `${v.toFixed(1)} m` : v >= 0.0995 ? `${Math.round(100 * v)} cm` : `${(1000 * v).toFixed(v < 0.01 ? 1 : 0)} mm`);

function markers(bounds) { // lanes that are not exact, and gaps, at least as large as a pointer
  if (view.mode !== "error") return;
  const bad = LANES.filter(l => inexact(l) && l.type.drivable).map(l => ({ ...l.error, lost: missing(l) }));
  bad.sort((a, b) => (b.lost ? -1 : b.worst) - (a.lost ? -1 : a.worst));
  for (const m of [...GAPS, ...bad]) {
    const x = toX(m.x), y = toY(m.y);
    if (!meets([m.x, m.y, m.x, m.y], bounds) || !free(x, y, 9, 9, m.lost ? 3 : 0)) continue;
    marker(m, x, y);
    const text = m.gap ? rough(m.gap) : m.lost ? null : rough(m.worst);
    if (text) pill(text, x + 34, y - 10, { size: 10, pad: 1, edge: LOOK.ink });
  }
}

function marker(m, x, y) {
  pen.beginPath();
  if (m.gap) { pen.moveTo(x, y - 6); pen.lineTo(x + 6, y); pen.lineTo(x, y + 6); pen.lineTo(x - 6, y); pen.closePath(); }
  else if (m.lost) { pen.moveTo(x - 4, y - 4); pen.lineTo(x + 4, y + 4); pen.moveTo(x - 4, y + 4); pen.lineTo(x + 4, y - 4); }
  else { pen.moveTo(x, y - 7); pen.lineTo(x + 6.5, y + 5); pen.lineTo(x - 6.5, y + 5); pen.closePath(); }
  pen.strokeStyle = "#fff"; pen.lineWidth = m.lost ? 5 : 3; pen.stroke();
  if (m.lost) { pen.strokeStyle = MISSING; pen.lineWidth = 2.4; pen.stroke(); }
  else { pen.fillStyle = m.gap ? "#111" : errorColor(m.worst); pen.fill(); if (!m.gap) { pen.strokeStyle = "#111"; pen.lineWidth = 1; pen.stroke(); } }
}
