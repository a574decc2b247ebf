// The arm where a finding moves the target most: its links, what the finding moves, where the target goes.
function posed(finding, posture) {
  const width = 460, height = 330, points = posture.origins_mm, target = points[points.length - 1];
  const floor = Math.min(...points.map((p) => p[2])), shadow = points.map(([x, y]) => [x, y, floor]);
  const size = Math.hypot(...posture.moved_mm), times = size > 0 ? roundBelow(0.4 * boxOf(points).radius / size) : 1;
  const tip = target.map((v, a) => v + times * posture.moved_mm[a]), { middle } = boxOf([...points, ...shadow, tip]);
  const radius = Math.max(1, ...[...points, ...shadow, tip].map((p) => Math.hypot(...p.map((v, a) => v - middle[a]))));
  // seen from the side: the arm, or if it stands upright the way of the target, lies across the picture
  const [across, deep] = [0, 1].map((a) => target[a] - points[0][a] + 2 * (tip[a] - target[a]));
  const view = { turn: 0.6 - Math.atan2(deep, across), lift: 0.3, zoom: 1 };
  const acting = new Set(posture.places.map((p) => p.frame));
  // joints whose frames share an origin, as those of a wrist
  const stacks = [];
  points.slice(1, -1).forEach((p, k) => {
    const same = stacks.find(([q]) => Math.hypot(...p.map((v, a) => v - q[a])) < 1);
    if (same) same[1].push(k + 1);
    else stacks.push([p, [k + 1]]);
  });
  const svg = mark("svg", { viewBox: `0 0 ${width} ${height}`, role: "img", tabindex: "0", class: "posture" });
  const scene = mark("g");

  // an arrow's head: a triangle in the plane of the picture
  function head([x0, y0], [x1, y1]) {
    const long = Math.hypot(x1 - x0, y1 - y0) || 1, [u, v] = [(x1 - x0) / long, (y1 - y0) / long];
    return `M${x1} ${y1}L${x1 - 9 * u - 4.5 * v} ${y1 - 9 * v + 4.5 * u}L${x1 - 9 * u + 4.5 * v} ${y1 - 9 * v - 4.5 * u}Z`;
  }

  function draw() {
    const place = (p) => project(p, middle, view, 0.46 * height / radius * view.zoom, width, height).map((v) => Number(v.toFixed(1)));
    const path = (list) => list.map((p, k) => `${k ? "L" : "M"}${place(p).join(" ")}`).join("");
    const line = (list, attributes) => mark("path", { d: path(list), fill: "none", "stroke-linejoin": "round", "stroke-linecap": "round", ...attributes });
    const nodes = [line(shadow, { stroke: "var(--line)", "stroke-width": 5 })];
    const base = points[0], foot = [base[0], base[1], floor], reach = 0.17 * radius;
    if (base[2] > floor + 1) nodes.push(line([foot, base], { stroke: "var(--line)", "stroke-width": 2, "stroke-dasharray": "3 3" }));
    nodes.push(line(points, { stroke: "var(--ink)", "stroke-width": 6 }));
    for (const { frame, axis, direction } of posture.places) {
      const from = points[frame].map((v, a) => v - (axis[0] === "r" ? reach : 0) * direction[a]), to = points[frame].map((v, a) => v + reach * direction[a]);
      nodes.push(line([from, to], { stroke: "var(--ring)", "stroke-width": 2, "stroke-dasharray": axis[0] === "r" ? "5 3" : "none" }));
      if (axis[0] === "t") nodes.push(mark("path", { d: head(place(from), place(to)), fill: "var(--ring)" }));
    }
    for (const [p, joints] of stacks) {
      const [x, y] = place(p), moves = joints.some((joint) => acting.has(joint));
      nodes.push(mark("circle", { cx: x, cy: y, r: moves ? 6.5 : 4.5, fill: moves ? "var(--ring)" : "var(--paper)", stroke: "var(--ink)", "stroke-width": 1.5 }));
      nodes.push(mark("text", { x: x + 9, y: y - 8 }, joints.join(", ")));
    }
    if (size > 0) {
      nodes.push(line([target, tip], { stroke: "var(--accent)", "stroke-width": 2.5 }));
      nodes.push(mark("path", { d: head(place(target), place(tip)), fill: "var(--accent)" }));
    }
    const [x, y] = place(target);
    nodes.push(mark("rect", { x: x - 4, y: y - 4, width: 8, height: 8, fill: acting.has(points.length - 1) ? "var(--ring)" : "var(--paper)", stroke: "var(--ink)", "stroke-width": 1.5 }));
    scene.replaceChildren(...nodes);
  }

  // a finding that only turns the target moves it nowhere
  const turned = posture.turned_mrad ?? null;
  const title = turned === null ? `The arm where this finding moves the target most, by ${digits(size)} mm.`
    : `The arm where this finding turns the target most, by ${digits(turned)} mrad; its position does not change.`;
  const arrow = turned === null ? `The arm where this finding moves the target most: ${digits(size)} mm (blue arrow, ${times.toLocaleString("en")} times as long). ` : `${title} `;
  const far = finding.unmeasured_joints;
  const beyond = far.length ? `There joint${far.length > 1 ? "s" : ""} ${far.join(", ")} stand${far.length > 1 ? "" : "s"} beyond the measured range. ` : "";
  svg.append(mark("title", {}, title), scene);
  turnable(svg, view, draw);
  draw();
  const said = `${arrow}${beyond}Orange: what it moves; dashed lines are axes that it turns about, arrows directions that it shifts along. Drag or arrow keys turn the arm, + and − zoom, 0 resets.`;
  return [svg, el("p", { class: "quiet", text: said })];
}
