// What is played: the drive, the time, the layers that are on; who is critical; the loop of frames.
const player = document.getElementById("player"), alone = player.dataset.alone === "yes";
const DARK_ROAD = { ...DARK, lane: lane => (lane.type.drivable ? "#2c343e" : "#20272f") };
const LIGHT_ROAD = { ...LIGHT, lane: lane => (lane.type.drivable ? "#d6dade" : "#eceae3") };
const CRITICAL = ["#c4161c", "#ff6b6b"];
const play = { drive: null, layers: [], t: 0, from: 0, to: 1, on: false, speed: 1, follow: true, trails: true, labels: true, plans: true, picked: null };
const dark = () => LOOK === DARK_ROAD, tone = pair => pair[dark() ? 1 : 0];

const visible = () => play.layers.filter(layer => layer.shown);

function choose(number) { // plays another drive of the page
  const drive = DATA.drives[number];
  play.number = number;
  play.drive = drive;
  play.layers = unpackDrive(drive);
  [play.from, play.to] = [drive.start, drive.end];
  play.t = play.from;
  play.picked = ruler.ends = null;
  setMap(DATA.maps[drive.map]);
  sorted = {};
  const [west, south, east, north] = drive.box;
  WHOLE = [west - 8, south - 8, east + 8, north + 8];
  groundOf = null;
}

function eyes() { // the EGO that is followed: of the first layer that is on and has it now
  for (const layer of visible()) if (layer.ego && layer.ego.there) return layer.ego;
  return null;
}

function seconds(danger, t) { // the scene of an assessment that holds at t, -1 where none does
  const k = last(danger.t, t + 0.05);
  return k >= 0 && t - danger.t[k] < 0.3 ? k : -1;
}

function critical() { // who is, by the first layer that is on and was assessed: risk first, then TTC
  for (const layer of visible()) {
    if (!layer.danger) continue;
    const danger = layer.danger, k = seconds(danger, play.t);
    if (k < 0) return null;
    const of = danger.risk_of[k] >= 0 ? danger.risk_of[k] : danger.ttc_of[k];
    return { layer, id: of < 0 ? null : danger.ids[of], risk: danger.risk[k], ttc: danger.ttc[k], unknown: danger.unknown[k] === 1 };
  }
  return null;
}

function follow() {
  const ego = play.follow && eyes();
  if (!ego) return;
  const ahead = 0.2; // of the picture: more is seen of what lies ahead
  view.x = ego.now.x + (ahead * Math.cos(ego.now.heading) * view.width) / view.scale;
  view.y = ego.now.y + (ahead * Math.sin(ego.now.heading) * view.height) / view.scale;
}

const work = new Float64Array(600); // ms of the last frames
let frames = 0, before = 0;

function frame(now) {
  if (play.on) {
    play.t = Math.min(play.t + (Math.min(now - before, 250) / 1000) * play.speed, play.to);
    if (play.t >= play.to) pause();
  }
  before = now;
  draw();
  if (play.on) requestAnimationFrame(frame);
}

function start() {
  if (play.on) return;
  if (play.t >= play.to - 1e-6) play.t = play.from;
  play.on = true;
  before = performance.now();
  told();
  requestAnimationFrame(frame);
}

function pause() {
  play.on = false;
  told();
  writeAddress();
}

function seek(t) {
  play.t = Math.min(Math.max(t, play.from), play.to);
  if (!play.on) writeAddressSoon();
  redraw();
}

function step(way) { // to the next sample of the first layer that is on
  if (play.on) pause();
  const layer = visible()[0] || play.layers[0], k = last(layer.times, play.t + 1e-6 * way);
  const next = way > 0 ? layer.times[k + 1] : layer.times[k] < play.t - 1e-6 ? layer.times[k] : layer.times[k - 1];
  if (next !== undefined) seek(next);
}

function draw() { // the whole frame
  const begin = performance.now();
  for (const layer of visible()) for (const object of layer.objects) place(object, play.t);
  follow();
  drawScene();
  drawCurves();
  tell();
  work[frames++ % work.length] = performance.now() - begin;
}

function share95() { // 95 % of the last frames took no more ms; how many there were
  const known = Array.from(work.subarray(0, Math.min(frames, work.length))).sort((a, b) => a - b);
  return [known[Math.floor(0.95 * (known.length - 1))] || 0, known.length];
}
