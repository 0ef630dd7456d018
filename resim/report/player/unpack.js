// The drives: packed numbers become arrays, by drive at its first use (resim/report/player/packing.py says how they are packed).
const DATA = JSON.parse(document.getElementById("player-data").textContent);

class Packed {
  constructor(text) {
    const raw = atob(text);
    this.bytes = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k++) this.bytes[k] = raw.charCodeAt(k);
    this.at = 0;
  }

  next() {
    let value = 0, size = 1, byte;
    do { byte = this.bytes[this.at++]; value += (byte & 127) * size; size *= 128; } while (byte & 128);
    return value % 2 ? -(value + 1) / 2 : value / 2;
  }

  read(count, order, unit, out = new Float64Array(count)) { // order: of the differences
    for (let k = 0, value = 0, step = 0; k < count; k++) {
      if (order === 2) { step += this.next(); value += step; } else value += this.next();
      out[k] = value * unit;
    }
    return out;
  }
}

function unpackTracks(packed, layer, ego) {
  const from = new Packed(packed.data), units = DATA.units, times = from.read(packed.count, 2, units.t);
  const objects = packed.objects.map(({ id, kind, length, width, times: strides, orders }) => {
    const count = strides.reduce((n, stride) => n + stride[2], 0), t = new Float64Array(count);
    let k = 0;
    for (const [first, step, many] of strides) for (let n = 0; n < many; n++) t[k++] = times[first + n * step];
    const [x, y, heading, v] = ["x", "y", "heading", "v"].map((name, c) => from.read(count, orders[c], units[name], new Float32Array(count)));
    return { id, kind, length, width, t, x, y, heading, v, layer, ego: id === ego, gap: longestGap(t), k: 0, now: { x: 0, y: 0, heading: 0, v: 0 }, there: false };
  });
  return { times, objects, byId: new Map(objects.map(o => [o.id, o])) };
}

function longestGap(t) { // s between samples across which an object is drawn
  const steps = Array.from(t.subarray(1, 200), (later, k) => later - t[k]).sort((a, b) => a - b);
  return Math.max(0.3, 2.2 * (steps[steps.length >> 1] || 0)) + 1e-6;
}

function unpackPlans(packed) {
  if (!packed) return [];
  const from = new Packed(packed.data), units = DATA.units, made = from.read(packed.count, 1, units.t);
  const counts = from.read(packed.count, 1, 1), x = from.read(packed.points, 1, units.x), y = from.read(packed.points, 1, units.y);
  let first = 0;
  return Array.from(made, (t, k) => {
    const plan = { t, x: x.subarray(first, first + counts[k]), y: y.subarray(first, first + counts[k]) };
    first += counts[k];
    return plan;
  });
}

function unpackDrive(drive) {
  if (drive.layers_) return drive.layers_;
  drive.layers_ = drive.layers.map(packed => {
    const layer = { ...packed };
    Object.assign(layer, unpackTracks(packed.tracks, layer, drive.ego), { plans: unpackPlans(packed.plans) });
    layer.ego = layer.byId.get(drive.ego) || null;
    return layer;
  });
  return drive.layers_;
}

function last(times, t) { // index of the last time that is not after t, -1 where there is none
  let low = -1, high = times.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (times[middle] <= t) low = middle; else high = middle - 1;
  }
  return low;
}

function place(object, t) { // puts object.now to time t; whether it is there
  const times = object.t, n = times.length;
  if (t < times[0] - 1e-3 || t > times[n - 1] + 1e-3) return (object.there = false);
  let k = object.k;
  if (!(times[k] <= t + 1e-9 && (k + 1 >= n || times[k + 1] > t + 1e-9))) k = Math.max(last(times, t + 1e-9), 0);
  object.k = k;
  const after = Math.min(k + 1, n - 1), step = times[after] - times[k], since = t - times[k], now = object.now;
  if (step > object.gap && since > 1e-3) return (object.there = false);
  const share = step > 0 && step <= object.gap ? Math.min(Math.max(since / step, 0), 1) : 0;
  for (const name of ["x", "y", "heading", "v"]) now[name] = object[name][k] + share * (object[name][after] - object[name][k]);
  return (object.there = true);
}
