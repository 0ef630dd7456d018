"use strict";
// Shows what changes: regions with data-live are fetched again after every change, a log grows as it is written.
(() => {
  const home = document.documentElement.dataset.home.slice(0, -1); // with what all addresses of this session begin
  const log = document.getElementById("log"), connection = document.getElementById("connection");
  let source = null, waiting = false, missed = false, from = log ? Number(log.dataset.from) : 0;

  const isAtEnd = () => log.scrollHeight - log.scrollTop - log.clientHeight < 40;
  const toEnd = () => { log.scrollTop = log.scrollHeight; };

  function isBusy(region) { // somebody is typing or choosing there, or has marked a text
    const at = document.activeElement, marked = document.getSelection();
    const types = at && region.contains(at) && at.matches("input, select, textarea");
    return types || (marked && !marked.isCollapsed && region.contains(marked.anchorNode));
  }

  function keepPlace(region, fresh) { // focus and sideways scrolling stay where they are
    const focused = region.contains(document.activeElement) ? document.activeElement : null;
    const name = focused && (focused.getAttribute("aria-label") || focused.getAttribute("href"));
    const scrolled = [...region.querySelectorAll(".wide")].map(box => box.scrollLeft);
    region.replaceChildren(...fresh.childNodes);
    region.querySelectorAll(".wide").forEach((box, k) => { box.scrollLeft = scrolled[k] || 0; });
    if (name) [...region.querySelectorAll("a, button")].find(e => (e.getAttribute("aria-label") || e.getAttribute("href")) === name)?.focus();
  }

  async function refresh(tick) {
    const regions = [...document.querySelectorAll("[data-live]")];
    if (!regions.length || (tick && !regions.some(r => r.dataset.live === "tick"))) return;
    if (waiting) { missed ||= !tick; return; } // what comes now may show what was before this change
    waiting = true;
    try {
      const answer = await fetch(location.href, { headers: { accept: "text/html" } });
      if (answer.status === 401) return location.reload();
      if (!answer.ok) return;
      const fresh = new DOMParser().parseFromString(await answer.text(), "text/html").querySelectorAll("[data-live]");
      if (fresh.length !== regions.length) return isBusy(document.body) || location.reload(); // another page by now
      regions.forEach((region, k) => { if (fresh[k] && !isBusy(region)) keepPlace(region, fresh[k]); });
    } catch { /* the stream says that the server is away */ } finally { waiting = false; }
    if (missed) { missed = false; refresh(false); }
  }

  function span(seconds) { // as `resim.supervisor.words.span` says it
    if (seconds < 100) return `${Math.round(seconds)} s`;
    if (seconds < 6000) return `${Math.round(seconds / 60)} min`;
    return seconds < 360000 ? `${(seconds / 3600).toFixed(1)} h` : `${Math.round(seconds / 86400)} days`;
  }

  function count() { // how long something has gone on is told without asking the server
    for (const told of document.querySelectorAll("[data-age]")) {
      told.begun ??= performance.now() - 1000 * Number(told.dataset.age);
      const words = span((performance.now() - told.begun) / 1000);
      if (told.textContent !== words) told.textContent = words;
    }
  }

  function listen() {
    if (source || document.hidden) return; // browsers have few connections a host: pages that nobody sees need none
    source = new EventSource(log ? `${home}/events?task=${log.dataset.task}&from=${from}` : `${home}/events`);
    source.addEventListener("open", () => { connection.textContent = "live"; });
    source.addEventListener("error", () => { connection.textContent = "the server does not answer; trying again"; });
    source.addEventListener("changed", () => refresh(false));
    source.addEventListener("tick", () => refresh(true));
    source.addEventListener("log", event => {
      const stays = !isAtEnd();
      log.append(JSON.parse(event.data));
      from = Number(event.lastEventId);
      if (!stays) toEnd();
    });
  }

  function look() {
    if (document.hidden) { source?.close(); source = null; } else { listen(); refresh(false); }
  }

  document.addEventListener("visibilitychange", look);
  window.addEventListener("pagehide", () => { source?.close(); source = null; });
  window.addEventListener("pageshow", listen);
  document.addEventListener("keydown", event => {
    if (event.key !== "/" || event.target.matches("input, select, textarea") || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    document.querySelector(".find input").select();
  });
  try { localStorage.setItem("home", home); } catch { /* then a bare address does not lead here */ }
  setInterval(count, 1000);
  if (log) toEnd();
  listen();
})();
