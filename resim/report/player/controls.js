// Buttons, keys, links, words; and the start.
const get = id => document.getElementById(id);
const details = get("details");
const make = (tag, props, ...inside) => { const e = Object.assign(document.createElement(tag), props); e.append(...inside); return e; };

function told() { // buttons as the player is
  get("play").setAttribute("aria-label", play.on ? "Pause" : "Play");
  get("play").classList.toggle("on", play.on);
  for (const name of ["follow", "trails", "labels", "plans"]) get(name).setAttribute("aria-pressed", String(play[name]));
  get("measure").setAttribute("aria-pressed", String(ruler.on));
  for (const button of get("layers").children) button.setAttribute("aria-pressed", String(play.layers[button.dataset.layer].shown));
  player.dataset.on = play.on ? "yes" : "no";
}

const riskWords = risk => (risk === null ? "–" : risk > 0 && risk < 0.0001 ? "< 0.0001" : String(Number(risk.toPrecision(2))));
let said = "";

const clock = get("clock"), slider = get("time");

function tell() { // the clock, and what holds now, in words
  slider.value = play.t;
  clock.textContent = `${play.t.toFixed(2)} s`;
  player.dataset.t = play.t.toFixed(3);
  const parts = visible().filter(layer => layer.ego && layer.ego.there).slice(0, 4).map(layer => `${layer.name} ${speedOf(layer.ego.now.v)}${accelerates(layer)}`);
  const who = critical();
  let words = parts.length ? `EGO: ${parts.join("; ")}` : "the EGO is not there";
  if (who) words += who.id === null ? ` · ${who.unknown ? "who is critical is not known: not all could be computed" : "nobody is critical"} (${who.layer.name})` : ` · critical: ${short(who.id)} (${who.layer.name}: TTC ${who.ttc === null ? "–" : `${who.ttc.toFixed(2)} s`}, risk ${who.risk === null ? "not computed" : riskWords(who.risk)}${who.unknown ? ", not all could be computed" : ""})`;
  if (words !== said) get("now").textContent = said = words;
  if (!details.hidden) show();
}

function accelerates(layer) {
  const of = layer.acceleration, k = of ? last(of.t, play.t + 0.05) : -1;
  return k < 0 || of.a[k] === null ? "" : `, ${fixed(of.a[k], 1)} m/s²`;
}

function show() { // the object that was picked, by layer
  const list = make("dl", {}), rows = [];
  for (const layer of visible()) {
    const object = layer.byId.get(play.picked);
    if (!object) continue;
    const ego = layer.ego && layer.ego.there ? layer.ego.now : null, now = object.now;
    const far = ego && !object.ego ? `, ${Math.hypot(now.x - ego.x, now.y - ego.y).toFixed(1)} m from EGO` : "";
    const size = object.length && object.width ? `, ${object.length.toFixed(2)} × ${object.width.toFixed(2)} m` : "";
    rows.push([layer.name, object.there ? `${object.kind}, ${speedOf(now.v)}${far}${size}` : "not there now"]);
  }
  for (const [name, words] of rows) list.append(make("dt", { textContent: name }), make("dd", { textContent: words }));
  const id = play.picked === play.drive.ego ? `EGO (${play.picked})` : play.picked;
  details.replaceChildren(make("b", { textContent: id }), list);
}

function choosePicked(id) {
  play.picked = id;
  details.hidden = id === null;
  if (id !== null) show();
  redraw();
}

function fillLayers() {
  get("layers").replaceChildren(...play.layers.map((layer, k) => {
    const swatch = make("i", {}), [color] = [tone(layer.colors.ego)];
    swatch.style.borderColor = color;
    swatch.style.borderStyle = !layer.colors.dash.length ? "solid" : layer.colors.dash[0] < 4 ? "dotted" : "dashed";
    if (layer.colors.fill) swatch.style.background = layer.colors.fill > 0.5 ? color : `${color}55`;
    const button = make("button", { type: "button", title: `${layer.title} (key ${k + 1})` }, swatch, layer.name);
    button.dataset.layer = k;
    button.addEventListener("click", () => switchLayer(k));
    return button;
  }));
}

function switchLayer(k) {
  if (!play.layers[k]) return;
  play.layers[k].shown = !play.layers[k].shown;
  told();
  redraw();
}

function fillMarks() {
  const marks = play.drive.marks, list = get("marks");
  list.replaceChildren(...marks.map(mark => {
    const swatch = make("i", { className: mark.kind });
    swatch.style.color = markColor(mark);
    const words = [mark.source, mark.kind === "finding" ? mark.object : "", mark.text].filter(Boolean).join(" ");
    const button = make("button", { type: "button" }, swatch, make("b", { textContent: `${mark.start.toFixed(2)} s` }), ` ${words}`);
    button.addEventListener("click", () => { if (play.on) pause(); seek(mark.start); });
    return make("li", {}, button);
  }));
  get("marks-title").textContent = marks.length ? `Marks (${marks.length})` : "No marks";
  get("notes").replaceChildren(...play.drive.notes.map(words => make("li", { textContent: words })));
}

function load(number) {
  choose(number);
  get("drive").value = String(number);
  Object.assign(get("time"), { min: play.from, max: play.to, step: 0.01 });
  details.hidden = true;
  fillLayers();
  fillMarks();
  told();
}

function near() { // the view at the start: around the EGO, or all where that is not much more
  const width = Math.max(view.width < 600 ? 70 : 130, 1), whole = Math.max(WHOLE[2] - WHOLE[0], (WHOLE[3] - WHOLE[1]) * (view.width / view.height));
  if (whole < width) fit(WHOLE); else view.scale = view.width / width;
  view.x = (WHOLE[0] + WHOLE[2]) / 2;
  view.y = (WHOLE[1] + WHOLE[3]) / 2;
}

function readAddress() {
  const asked = new URLSearchParams(location.hash.slice(1)), number = parseInt(asked.get("drive"), 10) - 1, t = parseFloat(asked.get("t"));
  if (DATA.drives[number] && number !== play.number) { load(number); near(); }
  if (parseFloat(asked.get("w")) > 0) view.scale = Math.min(view.width / parseFloat(asked.get("w")), CLOSEST);
  if (!isFinite(t)) return;
  if (play.on) pause();
  play.t = Math.min(Math.max(t, play.from), play.to);
  if (!alone) player.scrollIntoView({ block: "start" });
  redraw();
}

function address() {
  const parts = [`t=${play.t.toFixed(2)}`];
  if (play.number) parts.unshift(`drive=${play.number + 1}`);
  return "#" + parts.join("&");
}

function writeAddress() {
  try { history.replaceState(null, "", address()); } catch { /* a page that was opened from a file may not set its address */ }
}

let soon = 0;
function writeAddressSoon() { clearTimeout(soon); soon = setTimeout(writeAddress, 250); }

function toMark(way) {
  const times = play.drive.marks.map(mark => mark.start).filter(t => (way > 0 ? t > play.t + 1e-3 : t < play.t - 1e-3));
  if (times.length) seek(way > 0 ? Math.min(...times) : Math.max(...times));
}

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 4, 8];
function faster(way) {
  const k = SPEEDS.indexOf(play.speed) + way;
  if (SPEEDS[k]) { play.speed = SPEEDS[k]; get("speed").value = String(play.speed); }
}

function flip(name) {
  play[name] = !play[name];
  told();
  redraw();
}

function measure(on) { setRuler(on); told(); }

function wholeDrive() { play.follow = false; told(); fit(WHOLE); }

const KEYS = {
  " ": () => (play.on ? pause() : start()), k: () => (play.on ? pause() : start()),
  ArrowRight: () => step(1), ArrowLeft: () => step(-1), "shift ArrowRight": () => seek(play.t + 1), "shift ArrowLeft": () => seek(play.t - 1),
  Home: () => seek(play.from), End: () => seek(play.to), "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: wholeDrive,
  f: () => flip("follow"), m: () => measure(!ruler.on), t: () => flip("trails"), l: () => flip("labels"), p: () => flip("plans"),
  ".": () => faster(1), ",": () => faster(-1), n: () => toMark(1), b: () => toMark(-1),
  Escape: () => { choosePicked(null); measure(false); },
};
(alone ? document : player).addEventListener("keydown", event => {
  const own = event.target, key = `${event.shiftKey && event.key.startsWith("Arrow") ? "shift " : ""}${event.key}`;
  if (event.ctrlKey || event.metaKey || event.altKey || own.tagName === "SELECT") return;
  if (own.tagName === "BUTTON" && (event.key === " " || event.key === "Enter")) return;
  if (own.tagName === "SUMMARY" && (event.key === " " || event.key === "Enter")) return;
  const does = /^[1-9]$/.test(key) ? () => switchLayer(Number(key) - 1) : KEYS[key];
  if (!does) return;
  event.preventDefault();
  does();
});

for (const [id, does] of Object.entries({
  play: () => (play.on ? pause() : start()), back: () => step(-1), forth: () => step(1), first: () => seek(play.from), final: () => seek(play.to),
  follow: () => flip("follow"), trails: () => flip("trails"), labels: () => flip("labels"), plans: () => flip("plans"), measure: () => measure(!ruler.on),
  closer: () => zoom(1.5), farther: () => zoom(1 / 1.5), all: wholeDrive,
})) get(id).addEventListener("click", does);
get("time").addEventListener("input", () => seek(Number(get("time").value)));
get("speed").addEventListener("change", () => { play.speed = Number(get("speed").value); });
get("drive").addEventListener("change", () => { if (play.on) pause(); load(Number(get("drive").value)); near(); writeAddress(); redraw(); });

listen({
  hover: () => {},
  moving: () => { if (play.follow) { play.follow = false; told(); } },
  leave: () => {},
  press: pressRuler,
  drag: dragRuler,
  tap: (px, py) => { if (ruler.on) tapRuler(px, py); else choosePicked(pick(px, py)); },
  wheel: event => alone || event.ctrlKey || document.activeElement === canvas, // else the page scrolls
});

let seeking = false;
const along = event => { const box = chart.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
chart.addEventListener("pointerdown", event => {
  const [px, py] = along(event), mark = markAt(px, py);
  chart.setPointerCapture(event.pointerId);
  seeking = !mark;
  if (play.on) pause();
  seek(mark ? mark.start : chartT(px));
  get("mark").textContent = mark ? [`${mark.start.toFixed(2)} s:`, mark.source, mark.kind === "finding" ? mark.object : "", mark.text].filter(Boolean).join(" ") : "";
});
chart.addEventListener("pointermove", event => { if (seeking && event.buttons) seek(chartT(along(event)[0])); });
for (const name of ["pointerup", "pointercancel"]) chart.addEventListener(name, () => { seeking = false; });

function resize() {
  chartWidth = chart.clientWidth;
  const was = sized(), side = player.querySelector(".side");
  if (!was) return;
  sideBox = [side.offsetLeft - 4, 0, view.width, side.offsetTop + side.offsetHeight + 4];
  if (!was.before) { near(); readAddress(); } else view.scale *= view.width / was.before;
  draw();
}

get("drive").append(...DATA.drives.map((drive, k) => make("option", { value: String(k), textContent: drive.name })));
get("drive").closest("label").hidden = DATA.drives.length < 2;
get("speed").append(...SPEEDS.map(speed => make("option", { value: String(speed), textContent: `${speed} ×`, selected: speed === 1 })));
setInterval(() => { const [ms, count] = share95(); Object.assign(player.dataset, { work: ms.toFixed(2), frames: count }); }, 500);
followScheme(isDark => {
  LOOK = isDark ? DARK_ROAD : LIGHT_ROAD;
  if (!play.drive) return;
  fillLayers();
  fillMarks();
  told();
  sheetOf = "";
  draw();
});
load(0);
new ResizeObserver(resize).observe(stage);
window.addEventListener("hashchange", readAddress);
resize();
