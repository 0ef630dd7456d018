// What the picture is drawn on and with; a page may draw on other paper.
const LIGHT = { paper: "#fbfbfa", ink: "#1d2733", halo: "rgba(255,255,255,.9)", band: "rgba(255,255,255,.82)", grid: "#e3e6ea", text: "#46505c", border: "rgba(52,62,74,.35)", junction: "#ece4f5", junctionEdge: "#8e6bb8", markEdge: "rgba(60,70,82,.45)", marks: 1, lane: null };
let LOOK = LIGHT;
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
