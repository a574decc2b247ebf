// Puts the page together from the data it carries; nothing is fetched.
(() => {
  const data = JSON.parse(document.getElementById("data").textContent), { result, details } = data;
  const names = data.names, panel = document.getElementById("panel");
  data.named = new Set(data.cells.map(([i, j]) => `${i},${j}`));
  let chosen = null;
  const show = (nodes, td = null) => {
    if (chosen) chosen.removeAttribute("aria-selected");
    if (td) td.setAttribute("aria-selected", "true");
    chosen = td;
    panel.replaceChildren(...nodes);
    panel.scrollTop = 0;
  };
  const openFinding = (k) => show(findingPanel(data, k));
  const openCell = (td) => { const [i, j] = td.dataset.cell.split(",").map(Number); show(cellPanel(data, i, j, openFinding), td); };

  const side = result.ladder[0].held_out.rms_mm === null ? "estimation" : "held_out", floor = result.noise_floor.rms_mm || result.noise_floor.coordinate_mm * Math.sqrt(3);
  const top = Math.log(Math.max(...result.ladder.map((r) => r[side].rms_mm || 0)) / floor);
  const ladder = el("table", { class: "plain" }, el("thead", {}, el("tr", {}, ...["model", "rms mm", ""].map((h) => el("th", { scope: "col", class: h === "rms mm" ? "number" : "", text: h })))));
  const body = el("tbody");
  data.ladder.forEach(([k, name]) => {
    const value = result.ladder[k][side].rms_mm, bar = el("div", { class: "bar" });
    bar.style.width = `${value > 0 && top > 0 ? Math.max(0, Math.min(100, 100 * Math.log(value / floor) / top)) : 0}%`;
    body.append(el("tr", {}, el("td", { text: name }), el("td", { class: "number", text: digits(value) }), el("td", { class: "track" }, bar)));
  });
  ladder.append(body);
  document.getElementById("ladder").append(ladder);

  const findings = document.getElementById("findings");
  if (!result.findings.length) findings.append(el("p", { text: result.nothing_else.sentence }));
  else {
    const table = el("table", { class: "plain stack" }), rows = el("tbody");
    table.append(el("thead", {}, el("tr", {}, ...["named", "what goes wrong", "verdict"].map((h) => el("th", { scope: "col", text: h })))), rows);
    const open = (k) => {
      const button = el("button", { type: "button", text: details.findings[k].label });
      button.addEventListener("click", () => { openFinding(k); panel.scrollIntoView({ block: "nearest" }); });
      return button;
    };
    data.told.forEach((k) => {
      const f = result.findings[k], what = el("td", { text: f.sentence });
      if (data.figures[k]) what.append(el("p", { class: "quiet", text: data.figures[k] }));
      rows.append(el("tr", {}, el("td", {}, open(k)), what, el("td", { text: f.doubtful ? `${f.verdict}, but doubtful` : f.verdict })));
    });
    findings.append(table);
    if (data.grouped.length) {
      findings.append(el("p", { text: data.small }));
      findings.append(el("p", { class: "tools" }, ...data.grouped.map(open)));
    }
  }

  const map = result.error_map, columns = details.map.columns.map((c, j) => [c, j]);
  const alone = (j) => map.f.filter((row) => row[j] !== null).length < 2;
  const wave = ([c, j]) => c.wave !== null && c.wave >= 3 && c.joint && alone(j), others = columns.filter((c) => !wave(c)).map(([, j]) => j);
  const places = map.places.map((name, i) => [`frame ${name}`, i]), host = document.getElementById("map");
  if (!map.causes.length) host.append(el("p", { text: "No mechanism may extend the base in this study: nothing was scanned." }));
  else grid(data, host, places, others, (i, j) => [i, j], others.map((j) => map.causes[j]), "Error map, places by causes", openCell, false);
  const waves = columns.filter(wave), counts = [...new Set(waves.map(([c]) => c.wave))].sort((a, b) => a - b);
  if (waves.length) {
    document.getElementById("waves-title").hidden = false;
    const joints = [...new Set(waves.map(([c]) => c.joint))].sort((a, b) => a - b);
    const at = new Map(waves.map(([c, j]) => [`${c.joint},${c.wave}`, [map.f.findIndex((row) => row[j] !== null), j]]));
    grid(data, document.getElementById("waves"), joints.map((n) => [`joint ${n}`, n]), counts, (n, count) => at.get(`${n},${count}`), counts.map(String),
      "Waves of each joint's own angle, joints by waves per turn", openCell, true);
  }
  if (details.rungs.length) space(data, names);
  document.documentElement.dataset.ready = "yes";
})();
