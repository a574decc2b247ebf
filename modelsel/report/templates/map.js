// The error map: grids to walk with the arrow keys; a cell opens its panel, a finding its own.
function numbers(data, i, j) {
  const { details } = data, place = details.map.places[i], column = details.map.columns[j], slopes = details.map.slopes[i][j] || [];
  const q = details.rows.q, angle = column.wave === null ? null : column.joint ? q.map((r) => r[column.joint - 1]) : column.values[0];
  const causes = angle ? [angle.map((a) => Math.sin(column.wave * a)), angle.map((a) => Math.cos(column.wave * a))] : column.values;
  const levers = place.d.map((d) => Math.hypot(...d)), most = Math.max(...levers);
  const rows = levers.map((v, k) => k).filter((k) => levers[k] > 0.2 * most && !details.rows.outlying[k]);
  const about = (rung) => {
    const r = place.turns_only ? rung.rotation_rad : rung.residual_mm;
    return rows.map((k) => place.d[k].reduce((sum, v, a) => sum + v * r[k][a], 0) / levers[k] ** 2);
  };
  const fitted = rows.map((k) => slopes.reduce((sum, b, n) => sum + b * causes[n][k], 0));
  const before = about(details.rungs[details.base]).map((v, n) => v + fitted[n]), after = about(details.rungs[details.rungs.length - 1]);
  const out = { unit: place.axis[0] === "r" ? "rad" : "mm", before, after, kind: "line", frames: [place.frame], axis: place.axis, title: `Residual about ${placeName(place)}` };
  if (angle) {
    const turn = 2 * Math.PI, fold = column.wave >= 3, own = rows.map((k) => angle[k]);
    out.x = own.map((a) => (fold ? ((column.wave * a) % turn + turn) % turn : a) * 180 / Math.PI);
    const low = fold ? 0 : Math.min(...out.x), high = fold ? 360 : Math.max(...out.x), grid = [...Array(121).keys()].map((k) => low + (high - low) * k / 120);
    const phase = grid.map((g) => g * Math.PI / 180 * (fold ? 1 : column.wave));
    out.curve = [grid, phase.map((a) => slopes[0] * Math.sin(a) + slopes[1] * Math.cos(a))];
    out.against = fold ? `${column.wave}*${column.angle}, folded` : column.angle;
    out.against_unit = "deg";
  } else if (causes.length === 1) {
    const shown = column.unit === "rad" ? 180 / Math.PI : 1;
    out.x = rows.map((k) => causes[0][k] * shown);
    const ends = [Math.min(...out.x), Math.max(...out.x)];
    out.curve = [ends, ends.map((v) => v / shown * slopes[0])];
    out.against = rounded(data.result.error_map.causes[j]);
    out.against_unit = column.unit === "rad" ? "deg" : column.unit;
  } else {
    out.x = fitted.map((v) => v * scaled(out.unit, Math.max(...fitted.map(Math.abs)))[0]);
    const ends = [Math.min(...fitted), Math.max(...fitted)], [factor, unit] = scaled(out.unit, Math.max(...fitted.map(Math.abs)));
    out.curve = [ends.map((v) => v * factor), ends];
    out.against = `fit of ${rounded(data.result.error_map.causes[j])}`;
    out.against_unit = unit;
  }
  return out;
}

const placeName = (place) => `frame ${place.frame} ${place.axis}`;

function related(data, i, j) {
  const place = data.details.map.places[i], causes = data.result.error_map.causes[j].split(" & ");
  const hit = (s) => s.frame === place.frame && s.axis === place.axis && causes.includes(s.cause);
  return data.result.findings.map((f, k) => [f, k]).filter(([f]) => f.credible_set.some((e) => e.screws.some(hit)));
}

function card(data, name) {
  const found = data.details.cards[name];
  if (!found) return null;
  const list = el("dl", { class: "card" });
  for (const [term, words] of [["mechanism", found.name], ["what goes wrong", found.sentence],
    ["usual causes", (found.usual_causes || []).join(", ")], ["equation", found.equation], ["source", found.source],
    ...found.terms.map((t) => [`${t.symbol} [${t.unit}]`, t.screws.slice(0, 4).join(", ") + (t.screws.length > 4 ? " …" : "") + t.expected])]) {
    if (words) list.append(el("dt", { text: term }), el("dd", { text: words }));
  }
  return list;
}

// The pictures of findings whose own cell this is: every other effect is in the model there.
function ownPictures(data, i, j) {
  const place = data.details.map.places[i], mine = (f) => f.credible_set.length && related(data, i, j).some(([g]) => g === f) &&
    f.credible_set[f.fitted].screws.some((s) => s.frame === place.frame && s.axis === place.axis);
  return data.result.findings.flatMap((f, k) => mine(f) ? data.details.findings[k].panels.filter((p) => p.frames.includes(place.frame) && p.axis === place.axis) : []);
}

function cellPanel(data, i, j, openFinding) {
  const place = data.details.map.places[i], map = data.result.error_map, name = data.details.map.named.find(([a, b]) => a === i && b === j);
  const out = [el("h3", { text: `${placeName(place)} · ${rounded(map.causes[j])}` }),
    el("p", { text: `F = ${digits(map.f[i][j])} for this cell alone beyond the base; probability of such a value by chance anywhere in the map: p = ${digits(map.p_family_wise[i][j])}.` })];
  const own = data.named.has(`${i},${j}`) ? ownPictures(data, i, j) : [];
  for (const p of own.slice(0, 2)) out.push(scatter({ ...p, title: `Residual about ${placeName(place)}` }));
  if (own.length) out.push(el("p", { class: "quiet", text: "All other effects are in the model. Squares: without this effect. Dots: with it. Line: the fitted effect." }));
  out.push(scatter(numbers(data, i, j)), el("p", { class: "quiet", text: "Relative to the base model, as in the map. Squares: residual of the base model about " +
    "this axis, all effects included. Dots: residual of the chosen model. Line: fit of this cell alone." }));
  const findings = related(data, i, j);
  out.push(el("h3", { text: "Credible set" }));
  if (!findings.length) out.push(el("p", { class: "quiet", text: "No finding counts this cell among its explanations." }));
  for (const [finding, k] of findings.slice(0, 3)) {
    const button = el("button", { type: "button", text: `Finding ${k + 1}: ${data.details.findings[k].label}` });
    button.addEventListener("click", () => openFinding(k));
    out.push(button, probabilities(finding.credible_set.slice(0, 8).map((e, n) => [data.entries[k][n], e.probability * data.listed[k], e.alike])));
  }
  out.push(el("h3", { text: "Mechanism" }));
  out.push((name && card(data, name[2])) || el("p", { class: "quiet", text: "No registered mechanism acts at this place by this cause alone." }));
  return out;
}

// probability beyond the explanations shown from which it is told
const LEAST_REST = 0.01;

function findingPanel(data, k) {
  const finding = data.result.findings[k], said = data.details.findings[k];
  const out = [el("h3", { text: `Finding ${k + 1}: ${said.label}` }), el("p", { text: finding.sentence })];
  if (data.figures[k]) out.push(el("p", { class: "quiet", text: data.figures[k] }));
  out.push(el("p", { text: data.advice[k].whole }), el("p", { class: "quiet", text: data.advice[k].proof }));
  if (!data.own[k].length) out.push(el("p", { class: "quiet", text: data.kindred[k].length
    ? "The map has no cell of this finding's own shape. Marked are, at its places, the strongest cells that depend on nothing but what it depends on." : "No cell of the map stands for this finding." }));
  for (const p of said.panels) out.push(scatter({ ...p, title: p.frames.length ? `Residual about frame ${p.frames.join(", ")} ${p.axis}` : "Displacement" }));
  if (said.panels.length) out.push(el("p", { class: "quiet", text: "Squares: without this effect. Dots: with it. Line: the fitted effect." }));
  if (said.posture) out.push(...posed(finding, said.posture));
  const shown = finding.credible_set.slice(0, 12).map((e, n) => [data.entries[k][n], e.probability * data.listed[k], e.alike]);
  const rest = shown.reduce((left, [, probability]) => left - probability, 1);
  out.push(el("h3", { text: "Credible set" }), probabilities(shown));
  if (rest >= LEAST_REST) out.push(el("p", { class: "quiet", text: `The other ${rest.toFixed(2)} is the probability of less likely explanations, and of shapes that are in no list.` }));
  const found = card(data, said.card || (finding.credible_set.length ? finding.credible_set[finding.fitted].mechanism : null));
  if (found) out.push(el("h3", { text: "Mechanism" }), found);
  return out;
}

// A window of the map: `rows` [name, key], `columns` [name, key, frame], `cell` (row's key, column's key) -> [place, cause].
// Columns share the window's width, rows scroll; each cell is kept in data.tds.
function grid(data, host, { rows, columns, cell, label, open }) {
  const map = data.result.error_map, biggest = Math.log10(Math.max(10, ...map.f.flat().filter((v) => v !== null)));
  const table = el("table", { class: "map", role: "grid", "aria-label": label }), head = el("thead");
  table.style.setProperty("--n", columns.length);
  const groups = columns.reduce((out, [, , group]) => { if (out.length && out[out.length - 1][0] === group) out[out.length - 1][1]++; else out.push([group, 1]); return out; }, []);
  const heading = (attributes, ...children) => el("th", { role: "columnheader", ...attributes }, ...children);
  // a group too narrow for its name has its number alone
  const word = (count, n) => el("span", { class: count < 5 ? "word short" : n ? "word" : "", text: "frame " });
  if (groups[0][0]) head.append(el("tr", { role: "row" }, el("td", { class: "corner" }), ...groups.map(([frame, count], n) =>
    heading({ class: "group", style: `grid-column: span ${count}`, "aria-colspan": count, "aria-label": `frame ${frame}` }, word(count, n), el("span", { text: String(frame) })))));
  head.append(el("tr", { role: "row" }, el("td", { class: "corner" }), ...columns.map(([name, , group]) =>
    heading({ title: group ? `frame ${group} ${name}` : name }, el("span", { class: group ? "axis" : "", text: name })))));
  const body = el("tbody"), cells = [];
  rows.forEach(([name, i]) => {
    const tr = el("tr", { role: "row" }, el("th", { scope: "row", role: "rowheader", title: name, text: name }));
    cells.push(columns.map(([, c]) => {
      const at = cell(i, c), td = el("td", { role: "gridcell" });
      tr.append(td);
      if (!at || map.f[at[0]][at[1]] === null) return null;
      const [a, b] = at, f = map.f[a][b], p = map.p_family_wise[a][b], place = placeName(data.details.map.places[a]);
      td.tabIndex = -1;
      td.style.setProperty("--s", (100 * Math.max(0, Math.log10(Math.max(f, 1))) / biggest).toFixed(0));
      const named = data.named.has(`${a},${b}`);
      if (p < 0.05) td.classList.add("out");
      if (named) td.classList.add("named");
      td.dataset.cell = `${a},${b}`;
      data.tds.set(td.dataset.cell, td);
      td.setAttribute("aria-label", `${place}, cause ${map.causes[b]}, F ${digits(f)}, p ${digits(p)}${named ? ", named in a finding" : ""}`);
      return td;
    }));
    body.append(tr);
  });
  table.append(head, body);
  host.replaceChildren(table);
  const flat = cells.flatMap((row, r) => row.map((td, c) => [td, r, c])).filter(([td]) => td);
  if (!flat.length) return;
  flat[0][0].tabIndex = 0;
  const walk = (r, c, dr, dc) => { for (r += dr, c += dc; cells[r] && c >= 0 && c < cells[r].length; r += dr, c += dc) if (cells[r][c]) return cells[r][c]; return null; };
  const focus = (td) => { if (!td) return; for (const [other] of flat) other.tabIndex = -1; td.tabIndex = 0; td.focus({ preventScroll: true }); centre(host, td); };
  for (const [td, r, c] of flat) {
    const hint = () => { document.getElementById("hover").textContent = td.getAttribute("aria-label"); };
    td.addEventListener("mouseenter", hint);
    td.addEventListener("focus", hint);
    td.addEventListener("click", () => { focus(td); open(td); });
    td.addEventListener("keydown", (e) => {
      const move = { ArrowRight: [0, 1], ArrowLeft: [0, -1], ArrowDown: [1, 0], ArrowUp: [-1, 0] }[e.key];
      const row = cells[r].filter(Boolean);
      if (move) focus(walk(r, c, ...move));
      else if (e.key === "Home") focus(row[0]);
      else if (e.key === "End") focus(row[row.length - 1]);
      else if (e.key === "Enter" || e.key === " ") open(td);
      else return;
      e.preventDefault();
    });
  }
}

// Scroll a window of the map, and nothing else, until a cell of it is well inside.
function centre(host, td) {
  const window_ = host.getBoundingClientRect(), at = td.getBoundingClientRect(), room = 0.25 * window_.height;
  if (at.top < window_.top + room) host.scrollTop -= window_.top + room - at.top;
  else if (at.bottom > window_.bottom - room) host.scrollTop += at.bottom - window_.bottom + room;
}
