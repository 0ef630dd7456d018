// Pointers and wheel on the canvas: drag and pinch move and zoom; the rest is told to who listens. The canvas in its size.
const pointers = new Map();
let pressed = null;

function spot(event) {
  const box = canvas.getBoundingClientRect();
  return [event.clientX - box.left, event.clientY - box.top];
}

// hover, tap, moving, leave: told of; press(px, py) and drag(px, py): who takes a drag gives true; wheel(event): may zoom
function listen({ hover, tap, moving, leave, press = () => false, drag = () => {}, wheel }) {
  let takes = false;
  canvas.addEventListener("pointerdown", event => {
    pointers.set(event.pointerId, spot(event));
    canvas.setPointerCapture(event.pointerId);
    pressed = pointers.size === 1 ? spot(event) : null;
    takes = pressed !== null && press(...pressed);
  });

  canvas.addEventListener("pointermove", event => {
    const now = spot(event), before = pointers.get(event.pointerId);
    if (!before) { hover(...now); return; }
    if (pressed && Math.hypot(now[0] - pressed[0], now[1] - pressed[1]) < 5) return;
    pressed = null;
    pointers.set(event.pointerId, now);
    if (takes) { drag(...now); return; }
    canvas.classList.add("moving");
    moving();
    const other = [...pointers].find(([id]) => id !== event.pointerId);
    if (!other) { move(now[0] - before[0], now[1] - before[1]); return; }
    const far = p => Math.hypot(p[0] - other[1][0], p[1] - other[1][1]);
    move((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
    zoom(far(now) / Math.max(far(before), 1), (now[0] + other[1][0]) / 2, (now[1] + other[1][1]) / 2);
  });

  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, event => {
    pointers.delete(event.pointerId);
    canvas.classList.remove("moving");
    if (name === "pointerup" && pressed) tap(...pressed);
    pressed = null;
    takes = false;
  });

  canvas.addEventListener("pointerleave", leave);
  canvas.addEventListener("dblclick", event => zoom(2, ...spot(event)));

  canvas.addEventListener("wheel", event => {
    if (!wheel(event)) return;
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 18 : event.deltaMode === 2 ? 300 : 1;
    zoom(Math.exp(-0.0016 * Math.max(-400, Math.min(400, event.deltaY * lines))), ...spot(event));
  }, { passive: false });
}

function sized() { // the canvas in the size of its stage; how wide it was before, null where there is no room
  const w = stage.clientWidth, h = stage.clientHeight, dots = window.devicePixelRatio || 1;
  if (!w || !h) return null;
  const before = view.width;
  [view.width, view.height] = [w, h];
  canvas.width = Math.round(w * dots);
  canvas.height = Math.round(h * dots);
  return { before };
}
