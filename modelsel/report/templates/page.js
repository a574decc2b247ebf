// Puts the page together from the data it carries; nothing is fetched.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent), { result, details } = data;
  prefixes.push(...data.prefixes);
  const names = data.names, panel = document.getElementById("panel");
  data.named = new Set(data.cells.map(([i, j]) => `${i},${j}`));
  data.tds = new Map();
  let chosen = [];
  const choose = (keys) => {
    for (const key of chosen) if (data.tds.has(key)) data.tds.get(key).removeAttribute("aria-selected");
    chosen = keys.filter((key) => data.tds.has(key));
    for (const key of chosen) data.tds.get(key).setAttribute("aria-selected", "true");
  };
  const show = (nodes, keys) => {
    choose(keys);
    panel.replaceChildren(...nodes);
    panel.scrollTop = 0;
  };
  // a finding: its cells are marked, the strongest of them and the panel are brought into view
  const openFinding = (k) => {
    const f = ([i, j]) => result.error_map.f[i][j], own = [...(data.own[k].length ? data.own[k] : data.kindred[k])].sort((a, b) => f(b) - f(a));
    show([steps(k), ...findingPanel(data, k)], own.map(String));
    const [first] = chosen;
    if (first) centre(data.tds.get(first).closest(".scroll"), data.tds.get(first));
    document.getElementById("split").scrollIntoView({ behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "auto" : "smooth" });
    panel.focus({ preventScroll: true });
  };
  // to the findings beside it
  const order = [...data.told, ...data.grouped];
  const steps = (k) => {
    const at = order.indexOf(k), go = (text, to) => {
      const button = el("button", { type: "button", text });
      button.disabled = to === undefined;
      button.addEventListener("click", () => openFinding(to));
      return button;
    };
    return el("p", { class: "tools" }, go("‹ Previous", order[at - 1]), go("Next ›", order[at + 1]));
  };
  const openCell = (td) => { const [i, j] = td.dataset.cell.split(",").map(Number); show(cellPanel(data, i, j, openFinding), [td.dataset.cell]); };

  const side = result.ladder[0].held_out.rms_mm === null ? "estimation" : "held_out", floor = result.noise_floor.rms_mm || result.noise_floor.coordinate_mm * Math.sqrt(3);
  const top = Math.log(Math.max(...result.ladder.map((r) => r[side].rms_mm || 0)) / floor);
  const ladder = el("table", { class: "plain" }, el("thead", {}, el("tr", {}, ...["model", "rms mm", ""].map((h) => el("th", { scope: "col", class: h === "rms mm" ? "number" : "", text: h })))));
  const body = el("tbody");
  data.ladder.forEach(([k, name]) => {
    const value = result.ladder[k][side].rms_mm, bar = el("div", { class: "bar" });
    bar.style.width = `${value > 0 && top > 0 ? Math.max(0, Math.min(100, 100 * Math.log(value / floor) / top)) : 0}%`;
    body.append(el("tr", {}, el("td", { text: name }), el("td", { class: "number", text: aligned(value) }), el("td", { class: "track" }, bar)));
  });
  ladder.append(body);
  document.getElementById("ladder").append(ladder);

  const findings = document.getElementById("findings");
  if (!result.findings.length) findings.append(el("p", { text: result.nothing_else.sentence }));
  else {
    const table = el("table", { class: "plain stack named" }), rows = el("tbody");
    table.append(el("thead", {}, el("tr", {}, ...["finding", "what goes wrong, what to do", "gain, rms", "verdict"].map((h) => el("th", { scope: "col", text: h })))), rows);
    const open = (k) => {
      const button = el("button", { type: "button", text: `${k + 1}\u00a0${details.findings[k].label}` });
      button.addEventListener("click", () => openFinding(k));
      return button;
    };
    data.told.forEach((k) => {
      const f = result.findings[k], what = el("td", { text: f.sentence }), { short, worth } = data.advice[k];
      if (data.figures[k]) what.append(el("p", { class: "quiet", text: data.figures[k] }));
      what.append(el("p", { text: `What to do. ${short}` }));
      rows.append(el("tr", {}, el("td", {}, open(k)), what, el("td", { "data-head": "gain, rms", text: worth }),
        el("td", { "data-head": "verdict", text: data.verdicts[k] })));
    });
    findings.append(table, el("p", { class: "quiet", text: data.worth }));
    if (data.grouped.length) {
      findings.append(el("p", { text: data.small }));
      findings.append(el("p", { class: "tools" }, ...data.grouped.map(open)));
    }
  }

  const map = result.error_map, columns = details.map.columns.map((c, j) => [c, j]);
  const alone = (j) => map.f.filter((row) => row[j] !== null).length < 2;
  const wave = ([c, j]) => c.wave !== null && c.wave >= 3 && c.joint && alone(j), others = columns.filter((c) => !wave(c)).map(([, j]) => j);
  const host = document.getElementById("map"), sorting = document.getElementById("order");
  const places = details.map.places.map((place, i) => [place.axis, i, place.frame]);
  const best = others.map((j) => [j, Math.max(...map.f.map((row) => row[j] ?? 0))]);
  const strongest = [...best].sort((a, b) => b[1] - a[1]).map(([j]) => j);
  const fill = () => {
    const rows = (sorting.value === "cause" ? others : strongest).map((j) => [rounded(map.causes[j]), j]);
    grid(data, host, { rows, columns: places, cell: (j, i) => [i, j], label: "Error map, causes by places", open: openCell });
    choose(chosen);
  };
  if (map.causes.length) fill();
  else { host.append(el("p", { text: "No candidate of this study can extend the base: nothing was scanned." })); sorting.disabled = true; }
  sorting.addEventListener("change", fill);
  const waves = columns.filter(wave), counts = [...new Set(waves.map(([c]) => c.wave))].sort((a, b) => a - b);
  if (waves.length) {
    document.getElementById("waves-title").hidden = false;
    const joints = [...new Set(waves.map(([c]) => c.joint))].sort((a, b) => a - b);
    const at = new Map(waves.map(([c, j]) => [`${c.joint},${c.wave}`, [map.f.findIndex((row) => row[j] !== null), j]]));
    // of many counts, every tenth has its number
    const name = (count, n) => (counts.length < 25 || n === 0 || count % 10 === 0 ? String(count) : "");
    grid(data, document.getElementById("waves"), {
      rows: joints.map((n) => [`joint ${n}`, n]), columns: counts.map((count, n) => [name(count, n), count, ""]), cell: (n, count) => at.get(`${n},${count}`),
      label: "Waves of each joint's own angle, joints by waves per turn", open: openCell,
    });
  }
  if (details.rungs.length) space(data, names);
  const asked = /^#finding-(\d+)$/.exec(location.hash);
  if (asked && result.findings[asked[1] - 1]) openFinding(asked[1] - 1);
  document.documentElement.dataset.ready = "yes";
})();
