// What is known of the board and the link: pill, counters, parameters, commands, log.

const $ = (id) => document.getElementById(id);

// Parameters that may be changed while the board runs: field, label, bounds, unit.
const PARAMETERS = [
  ["margin", "Uniqueness margin", 0, 200, ""],
  ["left_right_tolerance_px", "Left-right tolerance", 0, 16, "px"],
  ["texture_min", "Smallest texture", 0, 64, "levels"],
  ["speckle_size_min", "Smallest speckle", 0, 255, "px"],
  ["speckle_step_q4", "Step within a speckle", 0, 64, "1/16 px"],
  ["confidence_min", "Smallest confidence", 0, 255, ""],
];
const SEND_AFTER_MS = 150;

const words = (name) => name.replaceAll("_", " ");

// Fills a list of terms with pairs; those whose value is not 0 and that are faults stand out.
function fill(list, pairs) {
  list.replaceChildren(...pairs.map(([term, value, isFault]) => {
    const row = document.createElement("div");
    const [dt, dd] = [document.createElement("dt"), document.createElement("dd")];
    dt.textContent = term;
    dd.textContent = value;
    dd.dataset.name = term;
    if (isFault && value > 0) dd.dataset.bad = "";
    row.append(dt, dd);
    return row;
  }));
}

function fillItems(list, items) {
  const isAtEnd = list.scrollTop + list.clientHeight >= list.scrollHeight - 8;
  list.replaceChildren(...items.map(([text, more, data]) => {
    const item = document.createElement("li");
    const span = document.createElement("span");
    span.textContent = more;
    item.append(`${text} `, span);
    Object.assign(item.dataset, data);
    return item;
  }));
  if (isAtEnd) list.scrollTop = list.scrollHeight;
}

// Everything that is counted and should not happen.
export function faultsOf(status) {
  const { packets, frames, statistics } = status;
  const session = statistics?.session ?? {};
  const ofSession = Object.entries(session).filter(([name]) => name !== "frames" && name !== "lines");
  return frames.aborted + frames.with_gaps + frames.stray_lines + packets.broken + packets.too_long
    + packets.unknown + packets.stale + packets.lost + packets.restarts
    + (statistics?.link.dropped ?? 0) + ofSession.reduce((sum, [, count]) => sum + count, 0);
}

const SOURCE_WORDS = { connected: "connected", lost: "lost, trying again", ended: "recording has ended" };

// Shows a status, without the parameters.
export function showStatus(status) {
  const { source, board, packets, frames, statistics, camera, state } = status;
  const pill = $("link");
  pill.dataset.kind = source.kind;
  pill.textContent = `${source.name}: ${SOURCE_WORDS[source.kind]}`;
  pill.title = source.reason ?? "";
  $("device").textContent = board ? `${board.device} ${board.firmware}, ${board.preset || "no preset"}` : "";
  const faults = faultsOf(status);
  $("faults").textContent = faults;
  $("faults").toggleAttribute("data-any", faults > 0);

  fill($("counters"), [
    ["frames whole", frames.whole],
    ["frames with gaps", frames.with_gaps, true],
    ["frames aborted", frames.aborted, true],
    ...(frames.abort_reason ? [["last aborted because", frames.abort_reason]] : []),
    ["stray lines", frames.stray_lines, true],
    ["KiB received", Math.round(packets.bytes / 1024)],
    ...["messages", "broken", "too_long", "unknown", "stale", "lost", "restarts"]
      .map((name) => [`packets ${words(name)}`.replace("packets messages", "packets"), packets[name], name !== "messages"]),
  ]);
  const size = (view) => `${view.width_px} × ${view.height_lines}`;
  fill($("board"), [
    ...(board ? [
      ["camera's lines", `${size(board.raw)}, ${board.raw.format}`],
      ["matched", size(board.matched)],
      ["disparities", `${board.disparity_min_px} to ${board.disparity_min_px + board.disparity_count - 1} px`],
      ["rectifies", board.rectifies ? "yes" : "no"],
      ["calibration", board.calibration_crc32 == null ? "none" : board.calibration_crc32.toString(16).padStart(8, "0")],
    ] : []),
    ...(camera ? [
      ["focal length", `${camera.focal_px.toFixed(1)} px`],
      ["baseline", `${camera.baseline_mm.toFixed(1)} mm`],
      ["camera told by", camera.is_from_board ? "board" : "calibration"],
    ] : [["distances", "camera not known"]]),
    ...(state ? [["lines from", state.source === 1 ? "test pattern" : "camera"]] : []),
    ...Object.entries({ ...statistics?.session, ...statistics?.link })
      .map(([name, count]) => [words(name), count, !/^(frames|lines|packets|commands|frames_decimated)$/.test(name)]),
  ]);
  fillItems($("commands"), status.commands.map(({ sequence, name, outcome }) =>
    [name, outcome ?? "sent", outcome && outcome !== "done" ? { bad: "", sequence } : { sequence }]));
  fillItems($("log"), status.log.map(({ level, text }) => [text, level, { level }]));
}

// The controls of the parameters. `send` gets those that the user changes.
export class ParameterForm {
  constructor(send) {
    this.send = send;
    this.timers = new Map();
    this.inputs = new Map();
    for (const [field, label, min, max, unit] of PARAMETERS) {
      const input = Object.assign(document.createElement("input"), { type: "range", min, max, name: field });
      const output = document.createElement("output");
      const tell = () => { output.textContent = `${input.value} ${unit}`; };
      input.addEventListener("input", () => {
        tell();
        this.#later(field, () => Number(input.value));
      });
      this.#add(field, label, input, output, (value) => { input.value = value; tell(); });
    }
    const dense = Object.assign(document.createElement("input"), { type: "checkbox", name: "dense" });
    dense.addEventListener("input", () => this.#later("dense", () => dense.checked));
    this.#add("dense", "Fill in what is not found", dense, null, (value) => { dense.checked = value; });
    this.none = Object.assign(document.createElement("p"), { className: "hint" });
    this.none.textContent = "The board has not told its parameters.";
    $("parameters").append(this.none);
    $("parameters").addEventListener("submit", (event) => event.preventDefault());
    this.show(null);
  }

  // Shows the board's parameters, but for one that the user is about to change.
  show(parameters) {
    for (const [field, { label, set }] of this.inputs) {
      const value = parameters?.[field];
      label.hidden = value == null;
      if (value != null && !this.timers.has(field)) set(value);
    }
    this.none.hidden = parameters != null;
  }

  #add(field, text, input, output, set) {
    const label = document.createElement("label");
    // The first control within is the one that the label names.
    label.append(text, input, ...(output ? [output] : []));
    $("parameters").append(label);
    this.inputs.set(field, { label, set });
  }

  #later(field, value) {
    clearTimeout(this.timers.get(field));
    this.timers.set(field, setTimeout(() => {
      this.timers.delete(field);
      this.send({ board: { parameters: { [field]: value() } } });
    }, SEND_AFTER_MS));
  }
}
