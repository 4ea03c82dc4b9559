"use strict";
/* Starts Rerun's viewer on the session that this page is served for. ?theme=dark|light overrides
   the system's.

   Rerun's own page asks the internet for a font, for example recordings and for its newest release,
   and tells its makers how it is used. This one speaks to the session alone. */

/* A session's stream, rerun+http://127.0.0.1:9876/proxy, or .rrd files of this server, /0.rrd. */
const shown = document.documentElement.dataset.show
  .split(" ")
  .map((address) => (address.startsWith("/") ? location.origin + address : address));
const note = document.getElementById("note");
const words = document.getElementById("words");
const canvas = document.getElementById("canvas");

const NARROW = 700; // where the views side by side cannot be read any more [CSS pixels]
const NARROW_AS = 800; // how wide a narrow screen then takes itself to be [CSS pixels]

/* Whatever the viewer asks of anybody else is answered here, with nothing. */
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
      persist: false, // opens the same for everybody
      theme: new URLSearchParams(location.search).get("theme"),
      panel_state_overrides: narrow
        ? { top: "Hidden", blueprint: "Hidden", selection: "Hidden", time: "Hidden" }
        : { blueprint: "Hidden", selection: "Hidden" },
    });
    canvas.hidden = false;
    await viewer.start(canvas);
    note.hidden = true;
    window.viewer = viewer; // for whoever tests the page
    watch(viewer);
  } catch (error) {
    fail(error);
  }
}

/* Says so where the viewer breaks down later. */
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

/* A phone is asked first: the viewer is 43 MB, and small on it. */
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
