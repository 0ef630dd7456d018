// What the picture is drawn on and with; a page may draw on other paper.
const LIGHT = { paper: "#fbfbfa", ink: "#1d2733", halo: "rgba(255,255,255,.9)", band: "rgba(255,255,255,.82)", grid: "#e3e6ea", text: "#46505c", border: "rgba(52,62,74,.35)", junction: "#ece4f5", junctionEdge: "#8e6bb8", markEdge: "rgba(60,70,82,.45)", marks: 1, lane: null };
const DARK = { paper: "#14181d", ink: "#e8ecf1", halo: "rgba(16,20,25,.88)", band: "rgba(20,24,29,.82)", grid: "#1f262e", text: "#aab4c0", border: "rgba(170,180,195,.3)", junction: "#241f33", junctionEdge: "#5d4a80", markEdge: "rgba(0,0,0,.4)", marks: 0.5, lane: null };
let LOOK = LIGHT;

function followScheme(put) { // put(dark) now, whenever the reader's scheme changes, and light for paper
  const scheme = matchMedia("(prefers-color-scheme: dark)");
  let printing = false;
  const now = () => put(scheme.matches && !printing);
  now();
  scheme.addEventListener("change", now);
  addEventListener("beforeprint", () => { printing = true; now(); });
  addEventListener("afterprint", () => { printing = false; now(); });
}

const FONT = 'Inter, "Segoe UI", system-ui, "Helvetica Neue", Arial, "DejaVu Sans", sans-serif';
const minus = number => String(number).replace("-", "−");
const short = text => (text.length > 18 ? text.slice(0, 17) + "…" : text);

let taken = []; // boxes on the screen that hold something

function free(x, y, w, h, pad) { // takes the room, if it is free and in view
  const box = [x - w / 2 - pad, y - h / 2 - pad, x + w / 2 + pad, y + h / 2 + pad];
  if (box[0] < 2 || box[1] < 2 || box[2] > view.width - 2 || box[3] > view.height - 2) return false;
  if (taken.some(other => meets(box, other))) return false;
  taken.push(box);
  return true;
}
