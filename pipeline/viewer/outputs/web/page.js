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
const NARROW_AS = 480; // layout width of a narrow screen with tabs of its own [CSS pixels]
const WIDE_AS = 800; // the same while it has the wide ones [CSS pixels]
const NARROW_NAME = "narrow screen"; // of the narrow layout
const PERIOD = 2000; // between two looks at the layout [ms]
const ATTEMPTS = 5; // to set the narrow layout, each in vain

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
    if (narrow) viewer.open_channel("narrow", "narrow");
    watch(viewer);
    if (narrow) keepNarrow(viewer);
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

/* Gives the viewer the narrow layout whenever the one of the session, which is wide, has come. */
async function keepNarrow(viewer, attempt = 0) {
  let next = attempt;
  const layout = shownLayout(viewer);
  window.narrow = layout.includes(NARROW_NAME); // for tests
  if (window.narrow) {
    layWidth(NARROW_AS);
    next = 0;
  } else if (layout && attempt < ATTEMPTS) {
    const answer = await ask("narrow.rbl");
    if (answer.ok) {
      viewer.send_rrd_to_channel("narrow", new Uint8Array(await answer.arrayBuffer()));
      next += 1;
    }
  }
  setTimeout(keepNarrow, PERIOD, viewer, next);
}

/* The layout that is shown, as Rerun writes it; "" before there is one. */
function shownLayout(viewer) {
  try {
    return new TextDecoder("latin1").decode(viewer.save_blueprint());
  } catch {
    return "";
  }
}

function layWidth(width) {
  document.querySelector("meta[name=viewport]").content = `width=${width}`;
}

/* Ask first on a phone: the viewer is 43 MB. */
function offer() {
  const narrow = document.getElementById("narrow");
  words.hidden = true;
  narrow.hidden = false;
  document.getElementById("open").onclick = () => {
    narrow.hidden = true;
    layWidth(WIDE_AS);
    start({ narrow: true });
  };
}

if (window.innerWidth < NARROW) offer();
else start();
