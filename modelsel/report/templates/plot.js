// Small helpers: elements without markup, a scatter of residual against cause, numbers in words.
const SVG = "http://www.w3.org/2000/svg";

// a number and its unit stay on one line
function keepUnits(text) {
  return String(text).replace(/(\d) (?=(?:%|mm|µm|mrad|µrad|°C)(?!\w))/g, "$1\u00a0");
}

function el(name, attributes = {}, ...children) {
  const node = document.createElement(name);
  for (const [key, value] of Object.entries(attributes)) {
    if (key === "text") node.textContent = keepUnits(value);
    else node.setAttribute(key, value);
  }
  node.append(...children);
  return node;
}

function mark(name, attributes = {}, text = null) {
  const node = document.createElementNS(SVG, name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  if (text !== null) node.textContent = text;
  return node;
}

// A cause with its long numbers rounded, for people to read.
function rounded(cause) {
  return cause.replace(/\d+\.\d{4,}/g, (number) => String(Number(Number(number).toPrecision(4))));
}

function digits(value, count = 3) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  return String(Number(value.toPrecision(count))).replace("-", "−");
}

// The same with its closing zeros, so that a column of figures stands in line.
function aligned(value, count = 3) {
  const text = digits(value, count);
  return text === "–" || Math.abs(value) >= 10 ** count || Math.abs(value) < 1e-3 ? text : value.toPrecision(count).replace("-", "−");
}

// [size, factor, prefix]: an angle below this size has this prefix, as in sentences and in the PDF.
const prefixes = [];

function scaled(unit, biggest) {
  if (unit === "rad") {
    const [, factor, prefix] = prefixes.find(([size]) => biggest < size) ?? [Infinity, 1, ""];
    return [1 / factor, `${prefix}rad`];
  }
  return unit === "mm" && biggest < 0.5 ? [1e3, "µm"] : [1, unit];
}

function ticks(low, high) {
  const step = roundBelow((high - low) / 3), out = [];
  for (let k = Math.ceil(low / step); k <= Math.floor(high / step + 1e-9); k++) out.push(k * step);
  return out;
}

// What turns or shifts, in words, as the PDF's pictures have it.
function motionOf(panel) {
  if (!panel.frames || !panel.frames.length) return "displacement along the effect";
  const motion = panel.axis[0] === "r" ? "turn about" : "shift along";
  return `${motion} ${panel.axis[1]} of frame ${panel.frames.slice(0, 3).join(" and ")}`;
}

// panel: {x, before, after, curve: [[x], [y]], unit, against, against_unit, title, frames, axis}
function scatter(panel) {
  const width = 460, height = 300, left = 52, right = 10, top = 14, bottom = 42;
  const all = [...panel.before, ...panel.after].map(Math.abs).sort((a, b) => a - b);
  const biggest = all.length ? all[Math.floor(0.98 * (all.length - 1))] : 1;
  const [factor, unit] = scaled(panel.unit, all.length ? all[Math.floor(0.99 * (all.length - 1))] : 1);
  const cause = rounded(panel.against);
  const most = panel.kind === "curve" || new Set(panel.x).size <= 6 ? Infinity : 3 * biggest, curved = Math.min(Math.max(0, ...panel.curve[1].map(Math.abs)), most);
  const high = Math.max(biggest * factor * 1.2, curved * factor * 1.05, 1e-12);
  let low = Math.min(...panel.x, ...panel.curve[0]), far = Math.max(...panel.x, ...panel.curve[0]);
  if (!(far > low)) { low -= 1; far += 1; }
  const room = 0.04 * (far - low), x0 = low - room, x1 = far + room;
  const X = (v) => left + (v - x0) / (x1 - x0) * (width - left - right);
  const Y = (v) => top + (1 - (v * factor + high) / (2 * high)) * (height - top - bottom);
  const svg = mark("svg", { viewBox: `0 0 ${width} ${height}`, role: "img" });
  svg.append(mark("title", {}, `${panel.title} against ${cause}: ${panel.x.length} rows, before and after.`));
  for (const t of ticks(-high, high)) {
    svg.append(mark("line", { x1: left, x2: width - right, y1: Y(t / factor), y2: Y(t / factor), stroke: "var(--line)" }));
    svg.append(mark("text", { x: left - 5, y: Y(t / factor) + 4, "text-anchor": "end" }, digits(t)));
  }
  for (const t of ticks(low, far)) svg.append(mark("text", { x: X(t), y: height - bottom + 15, "text-anchor": "middle" }, digits(t)));
  const against = panel.against_unit && panel.against_unit !== "1" ? ` [${panel.against_unit === "deg" ? "°" : panel.against_unit}]` : "";
  svg.append(mark("text", { x: (left + width) / 2, y: height - 8, "text-anchor": "middle" }, cause + against));
  svg.append(mark("text", { x: 2, y: 10 }, `${motionOf(panel)} [${unit}]`));
  const inside = (v) => Math.abs(v * factor) <= high;
  panel.x.forEach((x, k) => {
    if (inside(panel.before[k])) svg.append(mark("rect", { x: X(x) - 2, y: Y(panel.before[k]) - 2, width: 4, height: 4, fill: "none", stroke: "var(--before)" }));
    if (inside(panel.after[k])) svg.append(mark("circle", { cx: X(x), cy: Y(panel.after[k]), r: 1.9, fill: "var(--accent)", "fill-opacity": 0.75 }));
  });
  const step = panel.kind === "step";
  let path = "", last = null;
  panel.curve[0].forEach((x, k) => {
    const jump = last === null || (step && Math.sign(x) !== Math.sign(last));
    path += `${jump ? "M" : "L"}${X(x).toFixed(1)} ${Math.max(0, Math.min(height, Y(panel.curve[1][k]))).toFixed(1)}`;
    last = x;
  });
  svg.append(mark("path", { d: path, fill: "none", stroke: "var(--ring)", "stroke-width": 2 }));
  return svg;
}

// An orthographic view: turned by `turn` about z, lifted by `lift`; `scale` in pixels per mm.
function project(p, middle, view, scale, width, height) {
  const [x, y, z] = p.map((v, a) => v - middle[a]), c = Math.cos(view.turn), s = Math.sin(view.turn);
  const across = c * x - s * y, deep = s * x + c * y;
  return [width / 2 + scale * across, height / 2 - scale * (Math.cos(view.lift) * z - Math.sin(view.lift) * deep)];
}

// The middle of some points and half of their box's diagonal.
function boxOf(points) {
  const low = [0, 1, 2].map((a) => Math.min(...points.map((p) => p[a]))), high = [0, 1, 2].map((a) => Math.max(...points.map((p) => p[a])));
  return { low, high, middle: low.map((v, a) => (v + high[a]) / 2), radius: Math.max(1, Math.hypot(...low.map((v, a) => high[a] - v)) / 2) };
}

// Drag or arrow keys turn a view, + and - zoom, 0 resets.
function turnable(node, view, draw) {
  const home = { ...view };
  let grip = null;
  const lift = (by) => { view.lift = Math.max(-1.57, Math.min(1.57, view.lift + by)); };
  const reset = () => { Object.assign(view, home); draw(); };
  node.addEventListener("pointerdown", (e) => { grip = [e.clientX, e.clientY]; node.setPointerCapture(e.pointerId); });
  node.addEventListener("pointermove", (e) => {
    if (!grip) return;
    view.turn += (e.clientX - grip[0]) * 0.008;
    lift((e.clientY - grip[1]) * 0.008);
    grip = [e.clientX, e.clientY];
    draw();
  });
  for (const end of ["pointerup", "pointercancel"]) node.addEventListener(end, () => { grip = null; });
  const keys = {
    ArrowLeft: () => { view.turn -= 0.1; }, ArrowRight: () => { view.turn += 0.1; }, ArrowUp: () => lift(0.1), ArrowDown: () => lift(-0.1),
    "+": () => { view.zoom *= 1.15; }, "=": () => { view.zoom *= 1.15; }, "-": () => { view.zoom /= 1.15; }, "−": () => { view.zoom /= 1.15; },
    0: () => Object.assign(view, home),
  };
  node.addEventListener("keydown", (e) => {
    if (!keys[e.key]) return;
    keys[e.key]();
    e.preventDefault();
    draw();
  });
  return reset;
}

// 1, 2 or 5 times a power of ten, at most a value.
function roundBelow(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return [5, 2, 1].find((m) => m * power <= value * (1 + 1e-9)) * power;
}

// One below 0.9, from which a finding is proven, reads as below it.
function sayProbability(p) {
  if (p < 0.005) return "<0.01";
  return p < 0.9 && p >= 0.895 ? (Math.floor(p * 1000) / 1000).toFixed(3) : p.toFixed(2);
}

function probabilities(entries) {
  const set = el("div", { class: "set" });
  for (const [name, p, alike] of entries) {
    const bar = el("div", { class: alike ? "bar" : "bar other" });
    bar.style.width = `${Math.max(1, 100 * p)}%`;
    set.append(el("span", { text: name }), bar, el("span", { text: sayProbability(p) }));
  }
  return set;
}
