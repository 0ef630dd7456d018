// What pointing does, keys, buttons, search, table rows; and the start.
setMap(JSON.parse(document.getElementById("map-data").textContent));
let kept = false;

function keep(on) {
  kept = on;
  details.classList.toggle("kept", on);
  if (!on) details.hidden = true;
}

function measure(on) {
  keep(false);
  setRuler(on);
  document.getElementById("measure").setAttribute("aria-pressed", String(on));
}

listen({
  hover: (px, py) => { if (!kept && !ruler.on) inspect(px, py); },
  press: pressRuler,
  drag: dragRuler,
  moving: () => { if (!kept) details.hidden = true; },
  tap: (px, py) => {
    if (ruler.on) { tapRuler(px, py); return; }
    keep(false);
    const found = inspect(px, py);
    view.chosen = found && found.outer ? { lanes: [found] } : null;
    keep(Boolean(found));
    redraw();
  },
  leave: () => {
    if (!kept) details.hidden = true;
    if (view.under) { view.under = null; redraw(); }
  },
  wheel: () => { if (kept) keep(false); return true; },
});

const KEYS = {
  "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), 0: whole, m: () => measure(!ruler.on),
  Escape: () => { view.chosen = null; measure(false); },
};
const ON_MAP = { // elsewhere they scroll the page
  ArrowLeft: () => move(80, 0), ArrowRight: () => move(-80, 0), ArrowUp: () => move(0, 80), ArrowDown: () => move(0, -80), Home: whole,
};
document.addEventListener("keydown", event => { // as in the player
  const does = KEYS[event.key] || (event.target === canvas && ON_MAP[event.key]);
  if (!does || event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "INPUT") return;
  event.preventDefault();
  does();
});

document.getElementById("all").addEventListener("click", () => { view.chosen = null; keep(false); whole(); });
document.getElementById("measure").addEventListener("click", () => measure(!ruler.on));
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
  const wider = sized();
  if (!wider) return;
  if (!wider.before) readAddress(); else if (!view.moved) fit(WHOLE); else view.scale *= view.width / wider.before;
  draw();
}
const DARK_MAP = { ...DARK, border: LIGHT.border, markEdge: LIGHT.markEdge, marks: LIGHT.marks }; // lanes have their colours on either paper
followScheme(isDark => { LOOK = isDark ? DARK_MAP : LIGHT; if (view.width) draw(); });
new ResizeObserver(resize).observe(stage);
window.addEventListener("hashchange", readAddress);
resize();
