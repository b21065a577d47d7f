// Where an effect acts on the way from the hung weight to the cell's reading, as a picture.
import { el } from "../dom.js";

const STAGES = [["tension", "Tension", "what reaches each tendon of what is hung"], ["geometry", "Geometry", "posture, tendon points, axes, lengths"],
  ["sharing", "Sharing", "how the hood shares tension out"], ["torque", "Torque", "at the joints"], ["reading", "Reading", "what the cell reports"]];
const SVG = "http://www.w3.org/2000/svg";

function svg(name, given = {}, ...children) {
  const node = document.createElementNS(SVG, name);
  for (const [k, v] of Object.entries(given)) node.setAttribute(k, v);
  node.append(...children);
  return node;
}

export function stages(stage) {
  const here = STAGES.findIndex(([name]) => name === stage);
  const wide = 150;
  const said = here < 0 ? "" : `It acts on ${STAGES[here][1].toLowerCase()}: ${STAGES[here][2]}.`;
  const out = svg("svg", { viewBox: `0 0 ${STAGES.length * wide + 160} 92`, class: "stages", role: "img", "aria-label": `From the weight to the reading. ${said}` });
  const label = (x, y, text, cls = "") => svg("text", { x, y, "text-anchor": "middle", class: cls }, text);
  const line = (x0, x1) => svg("path", { d: `M${x0} 40 H${x1 - 7} m-6 -5 l8 5 l-8 5`, class: "way" });
  out.append(svg("path", { d: "M30 20 v8 m-11 0 h22 l6 26 h-34 z", class: "weight" }), label(30, 14, "weight"), line(56, 90));
  STAGES.forEach(([, title, text], i) => {
    const x = 92 + i * wide;
    out.append(svg("rect", { x, y: 18, width: wide - 34, height: 44, rx: 8, class: i === here ? "stage here" : "stage" }), label(x + (wide - 34) / 2, 45, title, i === here ? "here" : ""));
    if (i === here) out.append(label(Math.max(x + (wide - 34) / 2, 130), 84, text, "said"));
    out.append(line(x + wide - 32, x + wide - 2));
  });
  const end = 92 + STAGES.length * wide;
  out.append(svg("circle", { cx: end + 26, cy: 40, r: 20, class: "stage" }), label(end + 26, 44, "cell"));
  // On a narrow page it is scrolled rather than made too small to read, and begins where the effect acts.
  const box = el("div", { class: "stages-scroll", tabIndex: 0, role: "group", "aria-label": "From the weight to the reading" }, out);
  requestAnimationFrame(() => {
    const mark = out.querySelector(".stage.here")?.getBoundingClientRect();
    if (mark) box.scrollLeft += mark.left + mark.width / 2 - box.getBoundingClientRect().left - box.clientWidth / 2;
  });
  return box;
}
