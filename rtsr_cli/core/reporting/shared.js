// What the parts of the script share, and the choice of metric and shot.
// The parts are joined in one function: shared, curves, viewer, report.
const data = JSON.parse(document.getElementById("data").textContent);
const COLOURS = 6;
const REFERENCE = "reference";
const names = [REFERENCE, ...data.methods];
const $ = (id) => document.getElementById(id);
const all = (query) => [...document.querySelectorAll(query)];
const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

/** An element; `about` holds properties, children are nodes or plain text. */
function make(name, about = {}, ...children) {
  const node = Object.assign(document.createElement(name), about);
  node.append(...children);
  return node;
}
const swatch = (method) => make("i", { className: `swatch m${method % COLOURS}` });
const option = (value, text) => make("option", { value, textContent: text });
const shotName = (shot) => data.shots[shot] || "the shot";

/** A number as the tables write it. */
function written(value, metric) {
  if (value === null || value === undefined) return "\u2013";
  if (!Number.isFinite(value)) return value > 0 ? "\u221e" : "\u2212\u221e";
  const digits = value.toFixed(metric.decimals);
  return digits.replace("-", Number(digits) === 0 ? "" : "\u2212");
}

// ---- metric and shot: one choice for shots, regions and curves ------------------------------

const choice = { metric: 0, shot: "*", base: -1 };

function choose(kind, value) {
  choice[kind] = value;
  for (const select of all(`[data-pick=${kind}]`)) select.value = value;
  for (const panel of all(".panel")) {
    const metric = data.metrics[choice.metric];
    panel.hidden = panel.dataset.metric !== (metric && metric.key)
      || (panel.dataset.shot !== undefined && panel.dataset.shot !== choice.shot);
  }
  plot.layOut();
}

function fillChoices() {
  for (const select of all("[data-pick=metric]")) {
    select.append(...data.metrics.map((metric, place) => option(place, metric.title)));
    select.onchange = () => choose("metric", Number(select.value));
  }
  for (const select of all("[data-pick=shot]")) {
    select.append(option("*", "all"), ...data.shots.map((shot, place) => option(place, shot)));
    select.onchange = () => choose("shot", select.value);
    select.closest("label").hidden = data.shots.length < 2;
  }
}
