"use strict";
// A table or figure that does not fit says so until it is scrolled to its end; keys scroll it, too.
(() => {
  const headings = [...document.querySelectorAll("h1, h2, h3, h4, summary, figcaption b")];

  function named(box) { // by the last heading before it
    const before = headings.filter(one => one.compareDocumentPosition(box) & Node.DOCUMENT_POSITION_FOLLOWING).pop();
    const what = `${box.querySelector("table") ? "Table" : "Figure"}, scrolls sideways`;
    return before ? `${what}: ${before.textContent.trim()}` : what;
  }

  for (const box of document.querySelectorAll(".wide")) {
    const hint = Object.assign(document.createElement("p"), { className: "more note", textContent: "more columns to the right →", hidden: true });
    box.before(hint);
    const look = () => {
      const left = box.scrollWidth - box.clientWidth - box.scrollLeft, over = box.scrollWidth - box.clientWidth > 1;
      hint.hidden = !over;
      hint.style.visibility = left > 1 ? "visible" : "hidden"; // it keeps its room, so that the table stays where it is
      for (const [name, value] of Object.entries({ tabindex: "0", role: "region", "aria-label": named(box) }))
        if (over) box.setAttribute(name, value); else box.removeAttribute(name);
    };
    const watch = new ResizeObserver(look);
    watch.observe(box);
    watch.observe(box.firstElementChild);
    box.addEventListener("scroll", look, { passive: true });
  }
})();
