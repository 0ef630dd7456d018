"use strict";
// A running simulation from above, its EGO in the middle: states come as events, roads are fetched as the EGO moves on.
(() => {
  const home = document.documentElement.dataset.home.slice(0, -1);
  const figure = document.getElementById("live"), canvas = figure.querySelector("canvas"), pen = canvas.getContext("2d");
  const words = document.getElementById("live-state"), task = figure.dataset.task, tone = name => getComputedStyle(figure).getPropertyValue(name).trim();
  let state = null, roads = null, fetching = false, scale = 4, due = false, source = null, telling = false; // px a metre

  async function fetchRoads() { // again where the EGO is half out of what is known
    const [, , x, y] = state.boxes[0];
    const known = roads && roads.map === state.map && Math.hypot(x - roads.origin[0], y - roads.origin[1]) < roads.reach / 2;
    if (fetching || known) return;
    fetching = true;
    try {
      const of = state.map, answer = await fetch(`${home}/live/${task}/roads`);
      if (answer.ok) roads = { ...(await answer.json()), map: of };
      if (roads && !roads.lanes.length) roads.reach = Infinity; // no map: not asked again
      draw();
    } catch { /* the stream says that the server is away */ } finally { setTimeout(() => { fetching = false; }, 1000); }
  }

  function path(points, at) {
    pen.beginPath();
    for (let k = 0; k < points.length; k += 2) pen.lineTo(...at(roads.origin[0] + points[k] / 100, roads.origin[1] + points[k + 1] / 100));
  }

  function box([id, kind, x, y, heading, v, length, width], at, isEgo) {
    const [px, py] = at(x, y), l = length * scale / 2, w = width * scale / 2;
    pen.save();
    pen.translate(px, py);
    pen.rotate(-heading);
    pen.fillStyle = tone(isEgo ? "--link" : "--faint");
    pen.beginPath();
    if (l < 2) pen.arc(0, 0, 3, 0, 7); else pen.rect(-l, -w, 2 * l, 2 * w);
    pen.fill();
    if (l >= 6) { pen.fillStyle = tone("--paper"); pen.fillRect(0.55 * l, -0.7 * w, 0.15 * l, 1.4 * w); } // its front
    pen.restore();
    if (scale < 2) return;
    pen.fillStyle = tone("--ink");
    pen.fillText(`${isEgo ? "EGO" : id} ${v.toFixed(1)} m/s`, px, py - Math.max(w, l * Math.abs(Math.sin(heading))) - 5);
  }

  function draw() {
    due = false;
    const dots = window.devicePixelRatio || 1, wide = canvas.clientWidth, high = canvas.clientHeight;
    if (canvas.width !== Math.round(wide * dots) || canvas.height !== Math.round(high * dots)) { canvas.width = Math.round(wide * dots); canvas.height = Math.round(high * dots); }
    pen.setTransform(dots, 0, 0, dots, 0, 0);
    pen.clearRect(0, 0, wide, high);
    if (!state) return;
    const [, , cx, cy] = state.boxes[0], at = (x, y) => [wide / 2 + (x - cx) * scale, high / 2 - (y - cy) * scale];
    if (roads) {
      pen.fillStyle = tone("--rule");
      for (const lane of roads.lanes) { path(lane, at); pen.fill(); }
      pen.strokeStyle = tone("--paper"); pen.lineWidth = 1.5;
      for (const line of roads.lines) { path(line, at); pen.stroke(); }
    }
    pen.font = "12px system-ui, sans-serif"; pen.textAlign = "center";
    for (let k = state.boxes.length - 1; k >= 0; k--) box(state.boxes[k], at, k === 0);
  }

  const redraw = () => { if (!due) { due = true; requestAnimationFrame(draw); } };
  const zoom = by => { scale = Math.min(40, Math.max(0.5, scale * by)); redraw(); };

  const told = () => `${state.t.toFixed(2)} of ${state.end.toFixed(2)} s · ${state.build}, seed ${state.seed} · EGO ${state.boxes[0][5].toFixed(1)} m/s · ${state.boxes.length - 1} ${state.boxes.length === 2 ? "object" : "objects"}`;

  function tell() { // in words twice a second, as nobody reads faster; the last state, too
    if (telling) return;
    telling = true;
    words.textContent = told();
    setTimeout(() => { telling = false; words.textContent = told(); }, 500);
  }

  function listen() {
    if (source || document.hidden) return;
    source = new EventSource(`${home}/events?live=${task}`);
    source.addEventListener("state", event => { state = JSON.parse(event.data); fetchRoads(); redraw(); tell(); });
  }

  const leave = () => { source?.close(); source = null; };
  document.addEventListener("visibilitychange", () => (document.hidden ? leave() : listen()));
  window.addEventListener("pagehide", leave);
  window.addEventListener("pageshow", listen);
  window.addEventListener("resize", redraw);
  document.getElementById("nearer").addEventListener("click", () => zoom(1.4));
  document.getElementById("farther").addEventListener("click", () => zoom(1 / 1.4));
  history.replaceState(null, "", `${home}/live?task=${task}`); // it stays this one when it ends, reloaded or not
  listen();
})();
