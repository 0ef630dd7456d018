// Pointer, wheel, keys, buttons, search, table rows; and the start.
const pointers = new Map();
let pressed = null, kept = false;

function spot(event) {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

function keep(on) {
  kept = on;
  details.classList.toggle("kept", on);
  if (!on) details.hidden = true;
}

canvas.addEventListener("pointerdown", event => {
  pointers.set(event.pointerId, spot(event));
  canvas.setPointerCapture(event.pointerId);
  pressed = pointers.size === 1 ? spot(event) : null;
});

canvas.addEventListener("pointermove", event => {
  const now = spot(event), before = pointers.get(event.pointerId);
  if (!before) { if (!kept) inspect(...now); return; }
  if (pressed && Math.hypot(now[0] - pressed[0], now[1] - pressed[1]) < 5) return;
  pressed = null;
  canvas.classList.add("moving");
  if (!kept) details.hidden = true;
  const other = [...pointers].find(([id]) => id !== event.pointerId);
  if (!other) move(now[0] - before[0], now[1] - before[1]);
  else {
    const far = p => Math.hypot(p[0] - other[1][0], p[1] - other[1][1]);
    move((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    zoom(far(now) / Math.max(far(before), 1), (now[0] + other[1][0]) / 2, (now[1] + other[1][1]) / 2);
  }
  pointers.set(event.pointerId, now);
});

for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => {
  pointers.delete(event.pointerId);
  canvas.classList.remove("moving");
  if (name === "pointerup" && pressed) {
    keep(false);
    const found = inspect(...pressed);
    view.chosen = found && found.outer ? { lanes: [found] } : null;
    keep(Boolean(found));
    redraw();
  }
  pressed = null;
});

canvas.addEventListener("pointerleave", () => {
  if (!kept) details.hidden = true;
  if (view.under) { view.under = null; redraw(); }
});

canvas.addEventListener("dblclick", event => zoom(2, ...spot(event)));

canvas.addEventListener("wheel", event => {
  event.preventDefault();
  if (kept) keep(false);
  const lines = event.deltaMode === 1 ? 18 : event.deltaMode === 2 ? 300 : 1;
  zoom(Math.exp(-0.0016 * Math.max(-400, Math.min(400, event.deltaY * lines))), ...spot(event));
}, { passive: false });

const KEYS = {
  ArrowLeft: () => move(80, 0), ArrowRight: () => move(-80, 0), ArrowUp: () => move(0, 80), ArrowDown: () => move(0, -80),
  "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: whole, Home: whole,
  Escape: () => { view.chosen = null; keep(false); redraw(); },
};
canvas.addEventListener("keydown", event => {
  if (!KEYS[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  KEYS[event.key]();
});

document.getElementById("all").addEventListener("click", () => { view.chosen = null; keep(false); whole(); });
document.getElementById("closer").addEventListener("click", () => zoom(1.8));
document.getElementById("farther").addEventListener("click", () => zoom(1 / 1.8));
document.getElementById("stretch").addEventListener("click", () => {
  setStretch(view.stretch === 1 ? bestStretch() : 1);
  whole();
});
for (const button of document.querySelectorAll("[data-mode]"))
  button.addEventListener("click", () => { setMode(button.dataset.mode); writeAddress(); });

let last = { text: null, turn: 0 };
document.getElementById("search").addEventListener("submit", event => {
  event.preventDefault();
  const text = document.getElementById("wanted").value, found = look(text), said = document.getElementById("said");
  last = { text, turn: last.text === text ? last.turn + 1 : 0 };
  if (!found.length) { said.textContent = text.trim() ? `no road or junction “${short(text.trim())}”` : ""; return; }
  const thing = found[last.turn % found.length], kind = thing.rings ? "junction" : "road";
  said.textContent = `${kind} ${short(thing.id)}` + (found.length > 1 ? `, ${(last.turn % found.length) + 1} of ${found.length}: Go for the next` : "");
  choose(thing, thing.box, 20);
});

for (const row of document.querySelectorAll("tr[data-x]")) {
  const go = () => {
    for (const other of document.querySelectorAll("tr.here")) other.classList.remove("here");
    row.classList.add("here");
    const x = Number(row.dataset.x) - MAP.origin[0], y = Number(row.dataset.y) - MAP.origin[1];
    const [road, section, id] = (row.dataset.lane || "").split("\t");
    const lanes = LANES.filter(l => l.road.id === road && l.section === Number(section) && l.id === Number(id));
    setMode("error");
    if (view.stretch !== 1) setStretch(1);
    choose({ lanes }, [x - 20, y - 10, x + 20, y + 10], 40);
    stage.scrollIntoView({ block: "center" });
    keep(Boolean(inspect(toX(x), toY(y))));
  };
  row.addEventListener("click", go);
  row.addEventListener("keydown", event => { if (event.key === "Enter") go(); });
}

const ids = document.getElementById("ids");
if (ROADS.length + JUNCTIONS.length < 3000)
  ids.append(...[...ROADS.map(r => `road ${r.id}`), ...JUNCTIONS.map(j => `junction ${j.id}`)].map(value => Object.assign(document.createElement("option"), { value })));

function resize() {
  const w = stage.clientWidth, h = stage.clientHeight, dots = window.devicePixelRatio || 1;
  if (!w || !h) return;
  const first = !view.width, wider = view.width ? w / view.width : 1;
  [view.width, view.height] = [w, h];
  canvas.width = Math.round(w * dots);
  canvas.height = Math.round(h * dots);
  if (first) readAddress(); else if (!view.moved) fit(WHOLE); else view.scale *= wider;
  draw();
}
new ResizeObserver(resize).observe(stage);
window.addEventListener("hashchange", readAddress);
resize();
