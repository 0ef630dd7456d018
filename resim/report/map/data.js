// The map as objects: lines in metres from MAP.origin, lanes with what is known of them.
let MAP, LINES, ROADS, LANES, MARKS, JUNCTIONS, GAPS, WHOLE;

class Line {
  constructor(steps) {
    this.n = steps.length / 2;
    this.x = new Float64Array(this.n);
    this.y = new Float64Array(this.n);
    const box = [Infinity, Infinity, -Infinity, -Infinity];
    for (let k = 0, x = 0, y = 0; k < this.n; k++) {
      x += steps[2 * k]; y += steps[2 * k + 1];
      this.x[k] = x / 100; this.y[k] = y / 100;
    }
    for (let k = 0; k < this.n; k++) grow(box, this.x[k], this.y[k]);
    this.box = box;
  }

  get along() { // length up to each point
    if (!this.lengths) {
      this.lengths = new Float64Array(this.n);
      for (let k = 1; k < this.n; k++)
        this.lengths[k] = this.lengths[k - 1] + Math.hypot(this.x[k] - this.x[k - 1], this.y[k] - this.y[k - 1]);
    }
    return this.lengths;
  }

  get length() { return this.along[this.n - 1]; }

  segment(d) { // index of the segment that holds length d
    let low = 0, high = this.n - 2;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.along[middle] <= d) low = middle; else high = middle - 1;
    }
    return low;
  }

  at(d) { // place and direction at length d
    const k = this.segment(d), step = this.along[k + 1] - this.along[k];
    const share = step > 0 ? Math.min(Math.max((d - this.along[k]) / step, 0), 1) : 0;
    const dx = this.x[k + 1] - this.x[k], dy = this.y[k + 1] - this.y[k];
    return { x: this.x[k] + share * dx, y: this.y[k] + share * dy, dx, dy };
  }

  nearest(x, y) { // how far a place is, at which segment and share of it, and whether left (+) or right (-)
    let best = { distance: Infinity };
    for (let k = 0; k + 1 < this.n; k++) {
      const dx = this.x[k + 1] - this.x[k], dy = this.y[k + 1] - this.y[k], square = dx * dx + dy * dy;
      const px = x - this.x[k], py = y - this.y[k];
      const share = square > 0 ? Math.min(Math.max((px * dx + py * dy) / square, 0), 1) : 0;
      const distance = Math.hypot(px - share * dx, py - share * dy);
      if (distance < best.distance) best = { distance, k, share, side: Math.sign(dx * py - dy * px) || 1 };
    }
    return best;
  }

  beside(offset) { // a line this far to the left
    const steps = [];
    for (let k = 0, px = 0, py = 0; k < this.n; k++) {
      const a = Math.max(k - 1, 0), b = Math.min(k + 1, this.n - 1);
      const dx = this.x[b] - this.x[a], dy = this.y[b] - this.y[a], size = Math.hypot(dx, dy) || 1;
      const x = 100 * (this.x[k] - (offset * dy) / size), y = 100 * (this.y[k] + (offset * dx) / size);
      steps.push(x - px, y - py);
      px = x; py = y;
    }
    return new Line(steps);
  }
}

function grow(box, x, y) {
  box[0] = Math.min(box[0], x); box[1] = Math.min(box[1], y);
  box[2] = Math.max(box[2], x); box[3] = Math.max(box[3], y);
}

function around(boxes) {
  const all = [Infinity, Infinity, -Infinity, -Infinity];
  for (const b of boxes) if (b[0] <= b[2]) { grow(all, b[0], b[1]); grow(all, b[2], b[3]); }
  return all;
}

function setMap(map) { // takes what `map_data` gives
  MAP = map;
  LINES = MAP.lines.map(steps => new Line(steps));
  ROADS = MAP.roads.map(road => ({ ...road, line: new Line(road.line), lanes: [], parts: [], outline: [] }));
  LANES = [];
  MAP.lanes.forEach(([r, section, id, type, way, length, least, most, limit], k) => {
    const road = ROADS[r], line = LINES[k];
    const sides = (road.outline[section] = road.outline[section] || { id: -1, outer: line }); // the rightmost comes first
    sides.inner = line;
    if (id === 0) { road.parts.push({ road, section, line }); return; }
    const error = MAP.errors && MAP.errors[k];
    const inner = LINES[id < 0 ? k + 1 : k - 1];
    const lane = {
      road, section, id, way, limit, inner, outer: line, type: MAP.types[type], centre: new Line(MAP.centres[k]),
      length: length / 100, least: least / 100, most: most / 100, box: around([inner.box, line.box]),
      error: error && { worst: error[0], mean: error[1], limit: error[2], s: error[3], x: error[4] - MAP.origin[0],
        y: error[5] - MAP.origin[1], sumo: error[6], remark: error[7] },
    };
    road.lanes.push(lane);
    LANES.push(lane);
  });
  for (const road of ROADS) road.box = around([road.line.box, ...road.lanes.map(lane => lane.box)]);

  MARKS = MAP.marks.map(([k, first, last, kind, color, width]) => ({ line: LINES[k], first, last, kind, color, width: width / 100 }));
  JUNCTIONS = MAP.junctions.map(junction => {
    const rings = junction.rings.map(steps => new Line(steps));
    return { ...junction, rings, box: around(rings.map(ring => ring.box)) };
  });
  GAPS = MAP.gaps.map(([from, to, gap, x, y]) => ({ from, to, gap, x: x - MAP.origin[0], y: y - MAP.origin[1] }));
  WHOLE = around([...ROADS.map(road => road.box), ...JUNCTIONS.map(junction => junction.box)]);
}

const missing = lane => lane.error && lane.error.worst === null;
const inexact = lane => lane.error && (lane.error.worst === null || lane.error.worst > lane.error.limit);
