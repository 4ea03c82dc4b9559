"use strict";
/* Starts Rerun's viewer on the session that this page is served for. ?theme=dark|light overrides
   the system's.

   Rerun's own page asks the internet for a font, for example recordings and for its newest release,
   and reports its use to its makers. This one connects to the session only. */

/* A session's stream, rerun+http://127.0.0.1:9876/proxy, or .rrd files of this server, /0.rrd. */
const shown = document.documentElement.dataset.show
  .split(" ")
  .map((address) => (address.startsWith("/") ? location.origin + address : address));
const note = document.getElementById("note");
const words = document.getElementById("words");
const canvas = document.getElementById("canvas");

const NARROW = 700; // below which views side by side are not readable [CSS pixels]
const NARROW_AS = 800; // layout width of a narrow screen [CSS pixels]

/* Requests of the viewer to any other address are answered here with an empty response. */
const origins = shown.map((address) => new URL(address.replace(/^rerun\+/, "")).origin);
origins.push(location.origin);
const ask = window.fetch.bind(window);
window.fetch = (request, options) => {
  const { origin } = new URL(request instanceof Request ? request.url : request, location.href);
  return origins.includes(origin)
    ? ask(request, options)
    : Promise.resolve(new Response(null, { status: 204 }));
};

async function start({ narrow = false } = {}) {
  words.hidden = false;
  try {
    await wasm_bindgen({ module_or_path: "re_viewer_bg.wasm" });
    const viewer = new wasm_bindgen.WebHandle({
      url: shown,
      hide_welcome_screen: true,
      check_for_updates_on_startup: false,
      persist: false, // opens in the same state every time
      theme: new URLSearchParams(location.search).get("theme"),
      panel_state_overrides: narrow
        ? { top: "Hidden", blueprint: "Hidden", selection: "Hidden", time: "Hidden" }
        : { blueprint: "Hidden", selection: "Hidden" },
    });
    canvas.hidden = false;
    await viewer.start(canvas);
    note.hidden = true;
    window.viewer = viewer; // for tests
    watch(viewer);
  } catch (error) {
    fail(error);
  }
}

/* Reports a later failure of the viewer. */
function watch(viewer) {
  if (viewer.has_panicked()) fail(viewer.panic_message());
  else setTimeout(watch, 1000, viewer);
}

function fail(error) {
  console.error(error);
  canvas.hidden = true;
  note.hidden = false;
  words.textContent = `The viewer does not run in this browser: ${error}`;
}

/* Ask first on a phone: the viewer is 43 MB, and small there. */
function offer() {
  const narrow = document.getElementById("narrow");
  words.hidden = true;
  narrow.hidden = false;
  document.getElementById("open").onclick = () => {
    narrow.hidden = true;
    document.querySelector("meta[name=viewport]").content = `width=${NARROW_AS}`;
    start({ narrow: true });
  };
}

if (window.innerWidth < NARROW) offer();
else start();
