"use strict";
// Runs the scripts that pages of a folder share: each comes packed, in a style sheet beside the page, and must have the hash of the page's policy.
(async () => {
  const LOST = "Plots and player need the file scripts.css, which lies beside this page in its folder: copy both.";
  const OLD = "Plots and player are drawn by scripts, which this browser could not unpack. Chromium 80, Firefox 113, Safari 16.4 and later can.";

  function complain(words) {
    document.body.prepend(Object.assign(document.createElement("p"), { className: "warnings", textContent: words }));
  }

  async function run(packed) {
    const bytes = Uint8Array.from(atob(packed), letter => letter.charCodeAt(0));
    const unpacked = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    const script = document.createElement("script");
    script.textContent = await new Response(unpacked).text();
    document.body.append(script);
  }

  for (const place of document.querySelectorAll("[data-script]")) {
    const packed = getComputedStyle(place).getPropertyValue("--script").replace(/["\s]/g, "");
    if (!packed) return complain(LOST);
    try {
      await run(packed);
    } catch {
      return complain(OLD);
    }
  }
})();
