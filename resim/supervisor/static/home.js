"use strict";
// Who is in and came by an address without a session, or by one of another session, is sent on to the own one.
(() => {
  let home = null;
  try { home = localStorage.getItem("home"); } catch { return; } // a browser that keeps nothing
  const path = location.pathname.replace(/^\/[0-9a-f]{32}(?=\/)/, "");
  if (!/^\/[0-9a-f]{32}$/.test(home) || location.pathname.startsWith(`${home}/`)) return;
  location.replace(home + path + location.search + location.hash);
})();
