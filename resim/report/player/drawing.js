// The scene: ground, trails, plans, boxes, labels.
const ground = document.createElement("canvas"), AROUND = 320; // px that the ground reaches beyond the picture
const TRAIL = 3, FRESH = 0.5; // s of a trail; s up to which a plan is the EGO's
let groundOf = null, sideBox = [0, 0, 0, 0]; // of the buttons on the picture

function paintGround(dots) {
  const own = pen, kept = { ...view };
  ground.width = Math.round((view.width + 2 * AROUND) * dots);
  ground.height = Math.round((view.height + 2 * AROUND) * dots);
  pen = ground.getContext("2d", { alpha: false });
  pen.setTransform(dots, 0, 0, dots, 0, 0);
  view.width += 2 * AROUND;
  view.height += 2 * AROUND;
  const bounds = window_(4);
  drawGround(bounds, new Set(LANES.filter(lane => meets(lane.box, bounds))));
  Object.assign(view, kept);
  pen = own;
  groundOf = { ...kept, look: LOOK, dots };
}

function putGround(dots) { // drawn again only where the view left it
  const off = () => [Math.round((groundOf.x - view.x) * sx() * dots), Math.round((view.y - groundOf.y) * sy() * dots)];
  const same = groundOf && groundOf.scale === view.scale && groundOf.width === view.width && groundOf.height === view.height && groundOf.look === LOOK && groundOf.dots === dots;
  if (!same || off().some(d => Math.abs(d) > AROUND * dots)) paintGround(dots);
  const [dx, dy] = off(), pad = Math.round(AROUND * dots);
  pen.setTransform(1, 0, 0, 1, 0, 0);
  pen.drawImage(ground, dx - pad, dy - pad);
  pen.setTransform(dots, 0, 0, dots, 0, 0);
}

function inView(object, pad) {
  const x = toX(object.now.x), y = toY(object.now.y);
  return x > -pad && y > -pad && x < view.width + pad && y < view.height + pad;
}

function drawTrails(layer) {
  pen.lineWidth = 1.6;
  pen.setLineDash(layer.colors.dash);
  for (const ego of [false, true]) {
    pen.beginPath();
    for (const object of layer.objects) {
      if (object.ego !== ego || !object.there || !inView(object, 400)) continue;
      let x = toX(object.now.x), y = toY(object.now.y);
      pen.moveTo(x, y);
      for (let k = object.k; k >= 0 && object.t[k] > play.t - TRAIL; k--) {
        if (k < object.k && object.t[k + 1] - object.t[k] > object.gap) break;
        const px = toX(object.x[k]), py = toY(object.y[k]);
        if (Math.abs(px - x) + Math.abs(py - y) < 3 && k > 0) continue;
        pen.lineTo((x = px), (y = py));
      }
    }
    pen.strokeStyle = tone(ego ? layer.colors.ego : layer.colors.other);
    pen.globalAlpha = 0.55;
    pen.stroke();
  }
  pen.globalAlpha = 1;
  pen.setLineDash([]);
}

function drawPlan(layer) {
  const plans = layer.plans, k = last(plans_(layer), play.t + 1e-6), plan = plans[k];
  if (!plan || play.t - plan.t > FRESH) return;
  pen.beginPath();
  for (let n = 0; n < plan.x.length; n++) pen[n ? "lineTo" : "moveTo"](toX(plan.x[n]), toY(plan.y[n]));
  pen.strokeStyle = LOOK.halo;
  pen.lineWidth = 5;
  pen.stroke();
  pen.strokeStyle = tone(layer.colors.ego);
  pen.lineWidth = 2.2;
  pen.setLineDash(layer.colors.dash);
  pen.stroke();
  pen.setLineDash([]);
  pen.fillStyle = pen.strokeStyle;
  pen.beginPath();
  for (let n = 0; n < plan.x.length; n++) { const x = toX(plan.x[n]), y = toY(plan.y[n]); pen.moveTo(x + 2.4, y); pen.arc(x, y, 2.4, 0, 7); }
  pen.fill();
}
const plans_ = layer => (layer.made = layer.made || layer.plans.map(plan => plan.t));

function outline(object, grow = 0) { // the box as a path; a dot where it is too small, or its size is not known
  const { x, y, heading } = object.now, px = toX(x), py = toY(y), l = ((object.length || 0) / 2) * view.scale + grow, w = ((object.width || 0) / 2) * view.scale + grow;
  pen.beginPath();
  if (l < 3 || w < 1) { pen.arc(px, py, 3.2 + grow, 0, 7); return false; }
  const c = Math.cos(heading), s = Math.sin(heading), at = (u, v) => [px + u * c - v * s, py - u * s - v * c];
  pen.moveTo(...at(l, w)); pen.lineTo(...at(l, -w)); pen.lineTo(...at(-l, -w)); pen.lineTo(...at(-l, w)); pen.closePath();
  return true;
}

function drawBox(object, layer) {
  const color = tone(object.ego ? layer.colors.ego : layer.colors.other), whole = outline(object);
  if (layer.colors.fill || !whole) {
    pen.globalAlpha = whole ? layer.colors.fill : 0.6;
    pen.fillStyle = color;
    pen.fill();
    pen.globalAlpha = 1;
  }
  pen.strokeStyle = color;
  pen.lineWidth = object.ego ? 2.2 : 1.6;
  pen.setLineDash(whole ? layer.colors.dash : []);
  pen.stroke();
  pen.setLineDash([]);
  if (!whole) return;
  const { x, y, heading } = object.now, l = (object.length / 2) * view.scale, w = (object.width / 2) * view.scale;
  if (w < 3) return;
  const c = Math.cos(heading), s = Math.sin(heading), px = toX(x), py = toY(y), at = (u, v) => [px + u * c - v * s, py - u * s - v * c];
  pen.beginPath(); // where its front is
  pen.moveTo(...at(0.45 * l, 0.8 * w)); pen.lineTo(...at(0.85 * l, 0)); pen.lineTo(...at(0.45 * l, -0.8 * w));
  pen.strokeStyle = layer.colors.fill > 0.5 ? LOOK.paper : color;
  pen.lineWidth = 1.4;
  pen.stroke();
}

function label(object, lines, color, bold) {
  const size = 12, x = toX(object.now.x), y = toY(object.now.y), c = Math.abs(Math.cos(object.now.heading)), s = Math.abs(Math.sin(object.now.heading));
  const l = ((object.length || 2) / 2) * view.scale, w = ((object.width || 2) / 2) * view.scale, up = l * s + w * c + 4, aside = l * c + w * s + 5;
  pen.font = `${bold ? 700 : 500} ${size}px ${FONT}`;
  const wide = Math.max(...lines.map(text => text.length)) * size * 0.56, high = lines.length * (size + 2);
  const places = [[0, -up - high / 2], [0, up + high / 2], [aside + wide / 2, 0], [-aside - wide / 2, 0]];
  const found = places.find(([dx, dy]) => free(x + dx, y + dy, wide, high, 1));
  if (!found) return false;
  pen.textAlign = "center"; pen.textBaseline = "middle";
  pen.strokeStyle = LOOK.halo; pen.lineWidth = 3.5; pen.fillStyle = color;
  const each = put => lines.forEach((text, k) => put(text, x + found[0], y + found[1] + (k - (lines.length - 1) / 2) * (size + 2)));
  each((...at) => pen.strokeText(...at));
  each((...at) => pen.fillText(...at));
  return true;
}

const fixed = (v, digits) => minus((Math.round(v * 10 ** digits) / 10 ** digits + 0).toFixed(digits)); // no minus before a zero
const speedOf = v => `${fixed(v, 1)} m/s`;

function drawLabels(who) {
  taken = [[0, view.height - 46, 170, view.height], sideBox];
  const seen = new Map();
  for (const layer of visible()) if (layer.name !== "variations") for (const object of layer.objects) if (object.there && !seen.has(object.id) && inView(object, 0)) seen.set(object.id, object); // a bundle has no room for names
  for (const object of seen.values()) { // boxes keep their middle free of the labels of others
    const far = Math.max(((object.length || 0) / 2) * view.scale * 0.6, 0), half = Math.max(((object.width || 0) / 2) * view.scale * 0.7, 2);
    for (const way of far > half ? [-1, 0, 1] : [0]) {
      const x = toX(object.now.x) + way * far * Math.cos(object.now.heading), y = toY(object.now.y) - way * far * Math.sin(object.now.heading);
      taken.push([x - half, y - half, x + half, y + half]);
    }
  }
  const middle = eyes() || { now: { x: view.x, y: view.y } };
  const weight = o => (o.ego ? -3e9 : who && o.id === who.id ? -2e9 : play.picked === o.id ? -1e9 : (o.now.x - middle.now.x) ** 2 + (o.now.y - middle.now.y) ** 2);
  for (const object of [...seen.values()].sort((a, b) => weight(a) - weight(b))) {
    const isCritical = who && who.id === object.id, color = isCritical ? tone(CRITICAL) : LOOK.ink;
    const name = object.ego ? "EGO" : short(object.id);
    if (label(object, [`${name} ${object.kind}`, speedOf(object.now.v)], color, object.ego || isCritical)) continue;
    label(object, [name], color, false);
  }
}

function drawScene() {
  const dots = window.devicePixelRatio || 1, shown = visible(), who = critical();
  putGround(dots);
  pen.lineJoin = "round";
  if (play.trails) for (const layer of shown) drawTrails(layer);
  if (play.plans) for (const layer of shown) drawPlan(layer);
  for (const layer of shown) for (const object of layer.objects) if (object.there && inView(object, 60)) drawBox(object, layer);
  const marked = who && who.id !== null && who.layer.byId.get(who.id);
  if (marked && marked.there) {
    outline(marked, 5);
    pen.strokeStyle = tone(CRITICAL);
    pen.lineWidth = 3;
    pen.stroke();
  }
  if (play.labels) drawLabels(who && who.id !== null ? who : null);
  drawRuler();
  scaleBar();
}

function pick(px, py) { // the id of the box under a place on the screen, its layer first that is drawn last
  for (const layer of [...visible()].reverse()) for (const object of layer.objects) {
    if (!object.there) continue;
    const dx = fromX(px) - object.now.x, dy = fromY(py) - object.now.y, c = Math.cos(object.now.heading), s = Math.sin(object.now.heading);
    const pad = 8 / view.scale;
    if (Math.abs(dx * c + dy * s) <= (object.length || 0) / 2 + pad && Math.abs(dy * c - dx * s) <= (object.width || 0) / 2 + pad) return object.id;
  }
  return null;
}
