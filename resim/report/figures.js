"use strict";
// Draws the figures once the library, which is packed in the page, is unpacked: in the page's colours, on paper in light ones.
(() => {
  const PRINTED = 980, HALF = 470; // px that a figure is laid out for on paper: alone, and beside another
  const NEUTRAL = 40; // of 255: colours with less between their parts are greys
  const LEGIBLE = 4.5; // least contrast (WCAG 2.2, 1.4.3)
  const LOST = "This figure is drawn by a script, which this browser could not unpack. Chromium 80, Firefox 113, Safari 16.4 and later can.";
  const LIGHT = { dark: false, paper: [255, 255, 255], ink: [29, 39, 51] }, DARK = { dark: true, paper: [15, 19, 23], ink: [232, 236, 241] };
  const WHITE = [255, 255, 255], BLACK = [0, 0, 0], NAMED = { white: WHITE, black: BLACK };
  const scheme = matchMedia("(prefers-color-scheme: dark)"), current = () => (scheme.matches ? DARK : LIGHT);
  const touched = matchMedia("(pointer: coarse)").matches;
  const plots = [...document.querySelectorAll(".plot")].map(plot => ({ plot, div: plot.querySelector("div"), packed: plot.querySelector("script").textContent, told: "" }));

  function parts(text) { // red, green, blue, opacity; null for what is no colour
    const word = text.trim().toLowerCase(), hex = /^#([0-9a-f]{2})([0-9a-f]{2})([0-9a-f]{2})$/.exec(word);
    if (NAMED[word]) return [...NAMED[word], 1];
    if (hex) return [...hex.slice(1).map(pair => parseInt(pair, 16)), 1];
    const rgb = /^rgba?\(([\d.]+), *([\d.]+), *([\d.]+)(?:, *([\d.]+))?\)$/.exec(word);
    return rgb && [...rgb.slice(1, 4).map(Number), rgb[4] === undefined ? 1 : Number(rgb[4])];
  }

  const mixed = (a, b, share) => a.map((value, k) => Math.round(value + share * (b[k] - value)));
  const linear = value => (value <= 10.31475 ? value / 3294.6 : ((value / 255 + 0.055) / 1.055) ** 2.4); // value: 0 to 255
  const luminance = ([r, g, b]) => 0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b);

  function contrast(a, b) {
    const [low, high] = [luminance(a), luminance(b)].sort((x, y) => x - y);
    return (high + 0.05) / (low + 0.05);
  }

  function legible(color, look) { // mixed with white, on light paper with black, as little as it takes
    for (let share = 0; share <= 1; share += 0.04) {
      const found = mixed(color, look.dark ? WHITE : BLACK, share);
      if (contrast(found, look.paper) >= LEGIBLE) return found;
    }
    return look.ink;
  }

  function toned(text, look, isText) { // a colour as this look has it: on dark paper greys change places
    const found = parts(text);
    if (!found || (!look.dark && !isText)) return text;
    const color = found.slice(0, 3), [low, high] = [Math.min(...color), Math.max(...color)];
    let shown = look.dark && high - low < NEUTRAL ? mixed(look.ink, look.paper, (low + high) / 510) : legible(color, look);
    if (isText) shown = legible(shown, look);
    return found[3] === 1 ? `rgb(${shown.join(",")})` : `rgba(${shown.join(",")},${found[3]})`;
  }

  function colored(part, look, inFont = false) { // a part of a figure in this look's colours; scales of colours mean something
    if (Array.isArray(part)) { part.forEach(one => one && typeof one === "object" && colored(one, look, inFont)); return; }
    for (const [key, value] of Object.entries(part)) {
      if (key === "colorscale") continue;
      if (typeof value === "string") {
        if (/color$/i.test(key)) part[key] = toned(value, look, inFont);
        else if (key === "text") part[key] = value.replace(/(<span style="color:)([^"]+)/g, (_, before, color) => before + toned(color, look, true));
      } else if (value && typeof value === "object") colored(value, look, /font$/i.test(key));
    }
  }

  function draw(look, printed = false) {
    for (const { plot, div, told } of plots) {
      const { data, layout, config } = JSON.parse(told), onScale = data.some(trace => trace.type === "heatmap");
      for (const trace of data) if (!(onScale && trace.type === "contour")) colored(trace, look); // lines on a scale of colours are seen on these
      colored(layout, look);
      layout.uirevision = "kept"; // the zoom outlasts another look
      if (touched) layout.dragmode = false; // a finger scrolls the page
      if (printed) layout.width = plot.closest(".panels") ? HALF : PRINTED;
      Plotly.react(div, data, layout, config);
    }
    for (const sample of document.querySelectorAll(".sample [stroke], .sample [fill]")) {
      if (sample.closest(".on-scale")) continue;
      for (const name of ["stroke", "fill"])
        if (sample.hasAttribute(name)) sample.style[name] = toned(sample.getAttribute(name), look, false);
    }
  }

  function unpacked(text) {
    const packed = Uint8Array.from(atob(text), letter => letter.charCodeAt(0));
    return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).text();
  }

  async function unpack() {
    for (const one of plots) one.told = await unpacked(one.packed);
    if (typeof Plotly !== "undefined") return; // from the file that pages of a folder share
    const script = document.createElement("script");
    script.textContent = await unpacked(document.getElementById("plotly").textContent);
    document.head.append(script);
    if (typeof Plotly === "undefined") throw new Error("the library did not run");
  }

  async function start() {
    for (const { div } of plots) div.style.height = `${div.dataset.height}px`; // what comes below stays in its place
    try {
      await unpack();
    } catch {
      for (const { plot } of plots) plot.replaceChildren(Object.assign(document.createElement("p"), { className: "note", textContent: LOST }));
      return;
    }
    draw(current());
    let printing = false; // meanwhile paper, which is light, is no change of the scheme
    scheme.addEventListener("change", () => printing || draw(current()));
    addEventListener("beforeprint", () => { printing = true; draw(LIGHT, true); });
    addEventListener("afterprint", () => { printing = false; draw(current()); });
    document.documentElement.dataset.figures = "drawn";
  }

  start();
})();
