// What is under the pointer, in words.
const details = document.getElementById("details");

function holds(lane, x, y) { // even-odd over the lane's ring
  const b = lane.box;
  if (x < b[0] || x > b[2] || y < b[1] || y > b[3]) return false;
  const { inner, outer } = lane, n = inner.n + outer.n;
  const point = k => (k < inner.n ? [inner.x[k], inner.y[k]] : [outer.x[n - 1 - k], outer.y[n - 1 - k]]);
  let inside = false, [px, py] = point(n - 1);
  for (let k = 0; k < n; k++) {
    const [qx, qy] = point(k);
    if (qy > y !== py > y && x < ((px - qx) * (y - qy)) / (py - qy) + qx) inside = !inside;
    px = qx; py = qy;
  }
  return inside;
}

function lanesAt(x, y) { // nearest centre first; what nobody drives on last
  return LANES.filter(lane => holds(lane, x, y))
    .map(lane => [lane, lane.centre.nearest(x, y).distance + (lane.type.drivable ? 0 : 1e3)])
    .sort((a, b) => a[1] - b[1]).map(([lane]) => lane);
}

function gapAt(px, py) {
  if (view.mode !== "error") return null;
  return GAPS.find(gap => Math.hypot(toX(gap.x) - px, toY(gap.y) - py) < 9) || null;
}

function along_(road, x, y) { // s and t on the reference line
  const { k, share, side, distance } = road.line.nearest(x, y);
  return { s: road.s[k] + share * (road.s[k + 1] - road.s[k]), t: side * distance };
}

const WAYS = { 1: "driven along s", "-1": "driven against s", 2: "driven both ways", 0: "" };
const laneName = lane => `road ${lane.road.id} · section ${lane.section} · lane ${minus(lane.id)}`;

function facts(lane, x, y, others) {
  const at = along_(lane.road, x, y), out = [["type", [lane.type.name, WAYS[lane.way]].filter(Boolean).join(", ")]];
  if (lane.road.name) out.push(["name", lane.road.name]);
  if (lane.road.junction !== null) out.push(["junction", lane.road.junction]);
  const width = lane.most - lane.least < 0.005 ? lane.most.toFixed(2) : `${lane.least.toFixed(2)} … ${lane.most.toFixed(2)}`;
  out.push(["here", `s ${at.s.toFixed(2)} m, t ${minus(at.t.toFixed(2))} m`],
    ["length", `${lane.length.toFixed(2)} m`], ["width", `${width} m`]);
  if (lane.way) out.push(["speed limit", lane.limit || "none given"]);
  if (lane.error) out.push(...errorFacts(lane.error));
  if (others.length) out.push(["also here", others.slice(0, 4).map(l => `${l.road.id} §${l.section} lane ${minus(l.id)}`).join("; ") + (others.length > 4 ? " …" : "")]);
  return out;
}

function errorFacts(error) {
  const sumo = error.sumo.slice(0, 4).join(" ") + (error.sumo.length > 4 ? ` … (${error.sumo.length})` : "");
  if (error.worst === null) return [["SUMO", `not in the net: ${error.remark}`]];
  const state = error.worst <= error.limit ? "within" : "beyond";
  return [["SUMO", sumo], ["error", `worst ${metres(error.worst)} at s ${error.s.toFixed(2)} m, mean ${metres(error.mean)}; ${state} the limit of ${1000 * error.limit} mm`],
    ...(error.remark ? [["remark", error.remark]] : [])];
}

function show(title, rows, px, py) {
  const list = document.createElement("dl");
  for (const [name, text] of rows) {
    list.append(Object.assign(document.createElement("dt"), { textContent: name }), Object.assign(document.createElement("dd"), { textContent: text }));
  }
  details.replaceChildren(Object.assign(document.createElement("b"), { textContent: title }), list);
  details.hidden = false;
  const w = details.offsetWidth, h = details.offsetHeight, right = px + 16 + w < view.width;
  details.style.left = `${Math.max(4, right ? px + 16 : px - 16 - w)}px`;
  details.style.top = `${Math.min(Math.max(4, py - 20), Math.max(4, view.height - h - 4))}px`;
}

function inspect(px, py) { // shows what is there; gives the lane or gap
  const x = fromX(px), y = fromY(py), gap = gapAt(px, py), found = lanesAt(x, y), lane = found[0];
  const digits = view.scale > 20 ? 3 : view.scale > 2 ? 2 : view.scale > 0.2 ? 1 : 0;
  document.getElementById("place").textContent =
    `x ${minus((x + MAP.origin[0]).toFixed(digits))} m, y ${minus((y + MAP.origin[1]).toFixed(digits))} m`;
  if (gap) show(`gap of ${metres(gap.gap)} in the map`, [["from", gap.from], ["to", gap.to]], px, py);
  else if (lane) show(laneName(lane), facts(lane, x, y, found.slice(1)), px, py);
  else {
    const junction = JUNCTIONS.find(j => j.rings.some(ring => holds({ box: ring.box, inner: ring, outer: { n: 0 } }, x, y)));
    if (junction) show(`junction ${junction.id}`, [["type", junction.type], ...(junction.name ? [["name", junction.name]] : [])], px, py);
    else details.hidden = true;
  }
  const under = gap || !lane ? null : { lanes: [lane] };
  if ((view.under && view.under.lanes[0]) !== (under && under.lanes[0])) { view.under = under; redraw(); }
  return gap || lane;
}

function choose(thing, box, least) { // outlines it and goes there
  view.chosen = thing;
  fit(box, least, 0.12);
  changed();
}

function look(wanted) { // the roads and junctions that a search means, exact ids first
  const text = wanted.trim(), only = /^j(unction)?\s+(.+)$/i.exec(text), road = /^r(oad)?\s+(.+)$/i.exec(text);
  const id = only ? only[2] : road ? road[2] : text, low = id.toLowerCase();
  const found = [...(only ? [] : ROADS), ...(road ? [] : JUNCTIONS)];
  const exact = found.filter(thing => thing.id === id);
  return exact.length ? exact : found.filter(thing => low && (thing.id.toLowerCase() === low || thing.name.toLowerCase().includes(low)));
}
