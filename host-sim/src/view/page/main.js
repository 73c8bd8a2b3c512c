// The page: what is shown, buttons and keys, and the values under the pointer.
//
// `window.vgstereo` has what the page shows, for whoever drives it from outside.

import { ParameterForm, showStatus } from "./board.js";
import { Cloud, pointsOf, rangeOf } from "./cloud.js";
import { connect } from "./connection.js";
import { INVALID, colourOf, drawLegend, drawPlanes, grey, loadColours, valueAt } from "./pictures.js";
import { drawPlan } from "./plan.js";

const $ = (id) => document.getElementById(id);
const RATE_FRAMES = 20;
const GUIDES = 12;

const TITLES = {
  raw: "Raw", rectified: "Rectified", disparity: "Disparity", depth: "Depth",
  confidence: "Confidence", cloud: "Cloud of points", scan: "Scan",
};
const NEEDED = { disparity: "disparities", depth: "depths", confidence: "confidences", cloud: "depths" };

const view = {
  shown: new Set(),
  isFrozen: false,
  areBoth: true,
  hasGuides: false,
  pointer: null,
  frame: null,
  status: null,
  values: null,
};
window.vgstereo = view;

const panels = new Map();
const arrivals = [];
let cloud = null;

// What is shown is kept in the address, so that it survives a reload.
function shownInAddress() {
  const names = location.hash.slice(1).split(",").filter((name) => name in TITLES);
  return names.length > 0 ? names : ["disparity", "confidence"];
}

function show(names) {
  view.shown = new Set(names);
  const inOrder = Object.keys(TITLES).filter((name) => view.shown.has(name));
  history.replaceState(null, "", `#${inOrder.join(",")}`);
  for (const button of document.querySelectorAll("[data-show]")) press(button, view.shown.has(button.dataset.show));
  for (const [name, panel] of panels) {
    if (!view.shown.has(name)) {
      panel.figure.remove();
      panels.delete(name);
      if (name === "cloud") cloud = null;
    }
  }
  for (const name of inOrder) {
    if (!panels.has(name)) panels.set(name, makePanel(name));
    $("panels").append(panels.get(name).figure);
  }
  $("nothing").hidden = inOrder.length > 0;
  send({ show: inOrder });
  draw();
}

function makePanel(name) {
  const figure = $("panel").content.cloneNode(true).querySelector("figure");
  figure.dataset.panel = name;
  figure.querySelector("h2").textContent = TITLES[name];
  const find = (selector) => figure.querySelector(selector);
  const panel = {
    figure, pixels: find(".pixels"), marks: find(".marks"), legend: find(".legend"),
    mark: find(".mark"), detail: find(".detail"), frameWidth: 0,
  };
  const { marks } = panel;
  marks.tabIndex = 0;
  marks.setAttribute("role", "img");
  marks.setAttribute("aria-label", TITLES[name]);
  if (name === "cloud") {
    cloud = new Cloud(panel.pixels, marks);
    marks.title = "Drag to turn, wheel or two fingers to come closer, double click to begin anew";
  } else if (name !== "scan") {
    marks.addEventListener("pointermove", (event) => pointAt(panel, event));
    marks.addEventListener("pointerdown", (event) => pointAt(panel, event));
  }
  return panel;
}

// Where in the frame an event on a picture is. On the right view it is the same column and line.
function pointAt(panel, event) {
  const box = panel.marks.getBoundingClientRect();
  const { pixels } = panel;
  if (!panel.frameWidth || !box.width) return;
  const column = Math.floor(((event.clientX - box.left) / box.width) * pixels.width);
  const line = Math.floor(((event.clientY - box.top) / box.height) * pixels.height);
  const [x0, y0] = panel.origin;
  movePointer((column % panel.frameWidth) + x0, Math.min(line, pixels.height - 1) + y0);
}

function movePointer(x, y) {
  const { board } = view.status ?? {};
  const region = view.frame?.region;
  const width = board?.matched.width_px ?? (region ? region.x_px + region.width_px : x + 1);
  const height = board?.matched.height_lines ?? (region ? region.y_lines + region.height_lines : y + 1);
  view.pointer = { x: Math.max(0, Math.min(width - 1, x)), y: Math.max(0, Math.min(height - 1, y)) };
  readOut();
  drawMarks();
}

function readOut() {
  const { pointer, frame } = view;
  if (!pointer) return;
  const planes = frame?.planes ?? {};
  const at = (name) => valueAt(planes[name], pointer.x, pointer.y);
  const disparity = at("disparities");
  const depth = at("depths");
  const confidence = at("confidences");
  view.values = {
    ...pointer,
    disparity_q4: disparity === INVALID ? null : (disparity ?? null),
    depth_mm: depth || null,
    confidence: confidence ?? null,
  };
  const { disparity_q4, depth_mm } = view.values;
  $("at").textContent = `${pointer.x}, ${pointer.y}`;
  $("disparity").textContent = disparity_q4 == null ? "none" : `${(disparity_q4 / 16).toFixed(4).replace(/0{1,2}$/, "")} px`;
  $("depth").textContent = depth_mm == null ? "none" : `${(depth_mm / 1000).toFixed(3)} m`;
  $("confidence").textContent = confidence == null ? "none" : confidence === 0 ? "0, filled in or none" : confidence;
  const { dataset } = $("readout");
  for (const [name, value] of Object.entries(view.values)) dataset[name] = value ?? "none";
}

function draw() {
  const { frame, status } = view;
  if (frame) {
    for (const [name, panel] of panels) drawPanel(name, panel, frame, status);
    const { latency_lines: lines } = status?.board ?? {};
    $("frame").textContent = frame.frame;
    const ms = (frame.duration_us / 1000 / frame.region.height_lines) * lines;
    $("latency").textContent = lines == null ? "–" : `${lines} lines, ${ms.toFixed(1)} ms`;
  }
  mark();
  readOut();
  drawMarks();
}

function drawPanel(name, panel, frame, status) {
  const { planes } = frame;
  panel.detail.textContent = "";
  const needed = NEEDED[name];
  const isThere = name === "scan" ? frame.scan : planes[needed ?? `${name}_left`];
  panel.figure.toggleAttribute("data-empty", !isThere);
  if (!isThere) {
    const lacksCamera = ["depth", "cloud", "scan"].includes(name) && status && !status.camera;
    panel.detail.textContent = lacksCamera
      ? "the camera is not known: give --calibration"
      : "not in this frame";
    return;
  }
  panel.origin = [isThere.x ?? 0, isThere.y ?? 0];
  panel.frameWidth = isThere.width;
  if (name === "raw" || name === "rectified") {
    const views = [planes[`${name}_left`], planes[`${name}_right`]].slice(0, view.areBoth ? 2 : 1);
    panel.figure.classList.toggle("wide", view.areBoth);
    drawPlanes(panel.pixels, views, grey);
    if (frame.focus) {
      const [left, right] = frame.focus.map((figure) => figure.toFixed(0));
      panel.detail.textContent = `focus ${left}${view.areBoth ? ` left, ${right} right` : ""}`;
    }
  } else if (name === "disparity") {
    const { board } = status ?? {};
    const low = board?.disparity_min_px ?? 0;
    const high = board ? low + board.disparity_count - 1 : Math.ceil(largest(isThere.values) / 16);
    drawPlanes(panel.pixels, [isThere], (value) => (value === INVALID ? undefined : colourOf(value, low * 16, high * 16)));
    legend(panel, low, high, `${low} px`, `${high} px`);
    panel.detail.textContent = `${share(isThere.values, (value) => value !== INVALID)} % of the pixels`;
  } else if (name === "depth") {
    const [near, far] = rangeOf(isThere);
    // Near is red, as a large disparity is.
    drawPlanes(panel.pixels, [isThere], (mm) => (mm === 0 ? undefined : colourOf(-mm, -far, -near)));
    legend(panel, -near, -far, `${(near / 1000).toFixed(2)} m`, `${(far / 1000).toFixed(2)} m`);
    panel.detail.textContent = `${share(isThere.values, (mm) => mm > 0)} % of the pixels`;
  } else if (name === "confidence") {
    drawPlanes(panel.pixels, [isThere], grey);
    panel.detail.textContent = `${share(isThere.values, (value) => value > 0)} % found`;
  } else if (name === "cloud") {
    if (!status?.camera) return;
    const points = pointsOf(frame, status.camera);
    cloud.show(points);
    panel.detail.textContent = cloud.gl ? `${points.places.length / 3} points` : "this browser has no WebGL";
  } else {
    drawPlan(panel.pixels, frame.scan);
    const seen = frame.scan.ranges_mm.filter((mm) => mm > 0);
    panel.detail.textContent = seen.length > 0 ? `nearest ${(Math.min(...seen) / 1000).toFixed(2)} m` : "nothing seen";
  }
}

const largest = (values) => values.reduce((most, value) => Math.max(most, value), 16);
const share = (values, isCounted) =>
  Math.floor((100 * values.reduce((sum, value) => sum + (isCounted(value) ? 1 : 0), 0)) / (values.length || 1));

function legend(panel, low, high, from, to) {
  panel.legend.hidden = false;
  const [first, last] = panel.legend.querySelectorAll("span");
  first.textContent = from;
  last.textContent = to;
  drawLegend(panel.legend.querySelector("canvas"), low, high);
}

// Says on each panel why it does not show the newest frame whole.
function mark() {
  const { frame, status } = view;
  const frames = status?.frames;
  const reasons = [
    view.isFrozen && "frozen",
    frame && !frame.is_whole && "lines are missing",
    frames?.is_last_aborted && `held: the newest frame was aborted, ${frames.abort_reason}`,
    status && status.source.kind === "lost" && "held: the source is lost",
  ].filter(Boolean);
  for (const { mark } of panels.values()) mark.textContent = reasons.join("; ");
}

// Draws pointer and guides above the pictures.
function drawMarks() {
  for (const [name, panel] of panels) {
    if (name === "cloud" || name === "scan" || !panel.frameWidth) continue;
    const { marks, pixels } = panel;
    const scale = (marks.clientWidth * devicePixelRatio) / pixels.width;
    Object.assign(marks, { width: Math.round(pixels.width * scale), height: Math.round(pixels.height * scale) });
    const context = marks.getContext("2d");
    context.lineWidth = Math.max(1, Math.round(devicePixelRatio));
    const line = (from, to, colour) => {
      context.strokeStyle = colour;
      context.beginPath();
      context.moveTo(...from);
      context.lineTo(...to);
      context.stroke();
    };
    const isPicture = name === "raw" || name === "rectified";
    if (isPicture && view.hasGuides) {
      for (let guide = 1; guide < GUIDES; guide++) {
        const y = Math.round((marks.height * guide) / GUIDES) + 0.5;
        line([0, y], [marks.width, y], "#5ad1e6aa");
      }
    }
    if (!view.pointer) continue;
    const [x0, y0] = panel.origin;
    const y = (view.pointer.y - y0 + 0.5) * scale;
    const arm = 9 * devicePixelRatio;
    const cross = (column, colour) => {
      const x = (column + 0.5) * scale;
      for (const [width, shade] of [[3, "#000000"], [1, colour]]) {
        context.lineWidth = width * devicePixelRatio;
        line([x - arm, y], [x + arm, y], shade);
        line([x, y - arm], [x, y + arm], shade);
      }
    };
    cross(view.pointer.x - x0, "#ffffff");
    if (isPicture && view.areBoth) {
      line([0, y], [marks.width, y], "#ffb04a99");
      // Where the right view shows the same, as far as it is known.
      const { disparity_q4 } = view.values ?? {};
      if (disparity_q4 != null) cross(panel.frameWidth + view.pointer.x - x0 - disparity_q4 / 16, "#ffb04a");
    }
  }
}

function press(button, isPressed) {
  button.setAttribute("aria-pressed", isPressed);
}

function onStatus(status) {
  const before = view.status;
  view.status = status;
  showStatus(status);
  parameters.show(status.state?.parameters ?? null);
  const { source, state } = status;
  const run = $("run");
  const isRunning = state?.is_started ?? false;
  run.firstChild.textContent = isRunning ? "Stop" : "Start";
  press($("pattern"), state?.source === 1);
  for (const id of ["run", "pattern"]) $(id).disabled = !state || source.kind !== "connected";
  const ends = {
    lost: `The source is lost and tried again every second: ${source.reason}`,
    ended: source.reason && `The recording is damaged: ${source.reason}`,
  };
  notice(ends[source.kind] ?? null);
  if (!before || JSON.stringify(before.board) !== JSON.stringify(status.board) || !!before.camera !== !!status.camera) draw();
  else mark();
}

function notice(text) {
  $("notice").hidden = !text;
  $("notice").textContent = text ?? "";
}

function onFrame(frame) {
  const now = performance.now();
  if (view.lastNumber !== frame.frame) {
    view.lastNumber = frame.frame;
    arrivals.push(now);
    while (arrivals.length > RATE_FRAMES) arrivals.shift();
  }
  if (view.isFrozen) return;
  view.frame = frame;
  requestAnimationFrame(draw);
}

// The rate of the frames that have come lately; none when no more come.
function showRate() {
  const [first, last] = [arrivals[0], arrivals.at(-1)];
  const isLive = arrivals.length > 1 && performance.now() - last < 3000;
  $("rate").textContent = isLive ? `${(((arrivals.length - 1) * 1000) / (last - first)).toFixed(1)} /s` : "–";
}

const toggle = (id, change) => $(id).addEventListener("click", () => { press($(id), change()); draw(); });

const send = connect({
  onOpen: () => { notice(null); show([...view.shown]); },
  onFrame,
  onStatus,
  onClose: () => {
    $("link").dataset.kind = "closed";
    $("link").textContent = "vgstereo view does not answer";
    notice("The command vgstereo view has ended or does not answer.");
  },
});
const parameters = new ParameterForm(send);

for (const button of document.querySelectorAll("button[data-key]")) {
  const key = document.createElement("kbd");
  key.textContent = button.dataset.key.toUpperCase();
  button.append(key);
  button.setAttribute("aria-keyshortcuts", button.dataset.key);
}
for (const button of document.querySelectorAll("[data-show]")) {
  button.addEventListener("click", () => {
    const names = new Set(view.shown);
    if (!names.delete(button.dataset.show)) names.add(button.dataset.show);
    show([...names]);
  });
}
toggle("freeze", () => (view.isFrozen = !view.isFrozen));
toggle("both", () => (view.areBoth = !view.areBoth));
toggle("guides", () => (view.hasGuides = !view.hasGuides));
press($("freeze"), false);
press($("both"), true);
press($("guides"), false);
$("run").addEventListener("click", () => send({ board: view.status?.state?.is_started ? "stop" : "start" }));
$("pattern").addEventListener("click", () => send({ board: { "test-pattern": view.status?.state?.source !== 1 } }));
$("reset").addEventListener("click", () => send({ board: "reset-counters" }));

document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey) return;
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
  const isOnPicture = document.activeElement?.classList.contains("marks");
  if (arrows[event.key] && isOnPicture) {
    const [dx, dy] = arrows[event.key].map((step) => step * (event.shiftKey ? 10 : 1));
    const region = view.frame?.region;
    const middle = region && { x: region.x_px + (region.width_px >> 1), y: region.y_lines + (region.height_lines >> 1) };
    const { x, y } = view.pointer ?? middle ?? { x: 0, y: 0 };
    movePointer(x + dx, y + dy);
    event.preventDefault();
    return;
  }
  const button = document.querySelector(`button[data-key="${CSS.escape(event.key.toLowerCase())}"]`);
  if (button && !button.disabled && !event.repeat) button.click();
});
window.addEventListener("resize", draw);
window.addEventListener("hashchange", () => show(shownInAddress()));
setInterval(showRate, 500);
loadColours().then(draw);
show(shownInAddress());
