// Residual vectors in the workspace: orthographic projection on a canvas, turned by drag or keys.
function space(data, shown) {
  const canvas = document.getElementById("space"), status = document.getElementById("space-status");
  const { result, details } = data, points = details.rows.measured_mm, keep = details.rows.outlying.map((o) => !o);
  const { low, high, middle, radius } = boxOf([...points, ...details.arm_mm]), view = { turn: -0.9, lift: 0.35, zoom: 1 };
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  let rung = details.rungs.length - 1, factor = 1, drawn = details.rungs[rung].residual_mm, running = 0;

  const rows = points.map((_, k) => k).filter((k) => keep[k]);
  function wanted(k) {
    const size = rows.map((i) => Math.hypot(...details.rungs[k].residual_mm[i])).sort((a, b) => a - b);
    const typical = size.length ? size[Math.floor(0.95 * (size.length - 1))] : 0;
    if (!(typical > 0)) return 1;
    return roundBelow(0.16 * radius / typical);
  }

  function draw() {
    const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = width * ratio; canvas.height = height * ratio;
    const pen = canvas.getContext("2d"), style = getComputedStyle(document.documentElement), colour = (n) => style.getPropertyValue(n).trim();
    pen.scale(ratio, ratio);
    const place = (p) => project(p, middle, view, 0.47 * Math.min(width, height) / radius * view.zoom, width, height);
    const line = (a, b) => { pen.beginPath(); pen.moveTo(...place(a)); pen.lineTo(...place(b)); pen.stroke(); };
    pen.strokeStyle = colour("--line"); pen.lineWidth = 1;
    for (let axis = 0; axis < 3; axis++) for (let corner = 0; corner < 4; corner++) {
      const [u, v] = [0, 1, 2].filter((a) => a !== axis), from = [0, 0, 0], to = [0, 0, 0];
      from[axis] = low[axis]; to[axis] = high[axis];
      from[u] = to[u] = corner & 1 ? high[u] : low[u]; from[v] = to[v] = corner & 2 ? high[v] : low[v];
      line(from, to);
    }
    pen.fillStyle = colour("--quiet"); pen.font = "12px sans-serif";
    ["x", "y", "z"].forEach((name, a) => { const p = [...low]; p[a] = high[a]; const [x, y] = place(p); pen.fillText(name, x + 4, y - 4); });
    pen.strokeStyle = colour("--ink"); pen.lineWidth = 2.5;
    details.arm_mm.slice(1).forEach((p, k) => line(details.arm_mm[k], p));
    pen.strokeStyle = colour("--accent"); pen.lineWidth = 1.3;
    for (const k of rows) line(points[k], points[k].map((v, a) => v + factor * drawn[k][a]));
    pen.fillStyle = colour("--ink");
    for (const k of rows) { const [x, y] = place(points[k]); pen.fillRect(x - 1, y - 1, 2, 2); }
  }

  function choose(k) {
    const from = drawn, oldFactor = factor, to = details.rungs[k].residual_mm, hold = document.getElementById("hold").checked;
    rung = k;
    const newFactor = hold ? factor : wanted(k), start = performance.now(), turn = ++running;
    const step = (now) => {
      if (turn !== running) return;
      const t = still.matches ? 1 : Math.min(1, Math.max(0, (now - start) / 350));
      factor = oldFactor * (newFactor / oldFactor) ** t;
      drawn = t < 1 ? to.map((v, i) => v.map((x, a) => from[i][a] + t * (x - from[i][a]))) : to;
      draw();
      if (t < 1) requestAnimationFrame(step);
    };
    step(start + (still.matches ? 1e9 : 0));
    const side = result.ladder[k].held_out.rms_mm === null ? "estimation" : "held_out";
    status.textContent = `${shown[k]}: rms error ${digits(result.ladder[k][side].rms_mm)} mm on ${side.replace("_", "-")} configurations; ` +
      `vectors drawn ${newFactor.toLocaleString("en")} times as long.`;
    canvas.setAttribute("aria-label", `Residual vectors of the model ${shown[k]}`);
    document.getElementById("rung").value = String(k);
    document.getElementById("before").setAttribute("aria-pressed", String(k === 0));
    document.getElementById("after").setAttribute("aria-pressed", String(k === details.rungs.length - 1));
  }

  const select = document.getElementById("rung");
  shown.forEach((name, k) => select.append(el("option", { value: k, text: name })));
  select.addEventListener("change", () => choose(Number(select.value)));
  document.getElementById("before").addEventListener("click", () => choose(0));
  document.getElementById("after").addEventListener("click", () => choose(details.rungs.length - 1));
  document.getElementById("reset").addEventListener("click", turnable(canvas, view, draw));
  window.addEventListener("resize", draw);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", draw);
  factor = wanted(rung);
  choose(rung);
}
