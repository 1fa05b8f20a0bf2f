"use strict";
(() => {
const data = JSON.parse(document.getElementById("data").textContent);
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
const swatch = (method) => make("i", { className: `swatch m${method}` });
const option = (value, text) => make("option", { value, textContent: text });
const shotName = (shot) => data.shots[shot] || "the shot";

/** A number as the tables write it. */
function written(value, metric) {
  if (value === null || value === undefined) return "\u2013";
  if (!Number.isFinite(value)) return value > 0 ? "\u221e" : "\u2212\u221e";
  return value.toFixed(metric.decimals).replace("-", "\u2212");
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

// ---- curves ---------------------------------------------------------------------------------

const plot = {
  canvas: $("plot"), hidden: new Set(), segments: [], at: null,
  margin: { left: 58, right: 16, top: 14, bottom: 28 },

  /** Put the chosen shots side by side on one axis and collect their points. */
  layOut() {
    const shots = choice.shot === "*" ? data.shots.map((_, k) => k) : [Number(choice.shot)];
    this.segments = [];
    let start = 0;
    for (const shot of shots) {
      const { frames, curves } = data.curves[shot];
      if (!frames.length || !data.metrics.length) continue;
      const lines = curves[choice.metric].map((curve) => this.points(curve, frames));
      const first = frames[0];
      const segment = { shot, frames, first, last: frames[frames.length - 1], start };
      segment.lines = lines.map((line) => this.relative(line, lines));
      this.segments.push(segment);
      start += segment.last - first + Math.max(1, (segment.last - first) * 0.02);
    }
    const last = this.segments[this.segments.length - 1];
    this.extent = last ? Math.max(last.start + last.last - last.first, 1) : 1;
    this.at = null;
    this.draw();
    this.say();
  },

  points(curve, frames) {
    if (!curve) return new Map();
    const at = curve.at || curve.values.map((_, k) => k);
    const known = at.map((place, k) => [frames[place], curve.values[k]]);
    return new Map(known.filter(([, v]) => v !== null).map(([frame, v]) => [frame, Number(v)]));
  },

  relative(line, lines) {
    if (choice.base < 0) return line;
    const base = lines[choice.base];
    const both = [...line].filter(([frame]) => base.has(frame));
    return new Map(both.map(([frame, v]) => [frame, v - base.get(frame)])
      .filter(([, v]) => !Number.isNaN(v)));
  },

  range() {
    let low = Infinity, high = -Infinity;
    for (const { lines } of this.segments) lines.forEach((line, method) => {
      if (this.hidden.has(method)) return;
      for (const v of line.values()) if (Number.isFinite(v)) {
        low = Math.min(low, v);
        high = Math.max(high, v);
      }
    });
    if (low > high) return [0, 1];
    const pad = (high - low) * 0.06 || Math.abs(high) * 0.05 || 0.5;
    return [low - pad, high + pad];
  },

  scales() {
    const { left, right, top, bottom } = this.margin;
    const width = this.canvas.clientWidth - left - right;
    const height = this.canvas.clientHeight - top - bottom;
    const [low, high] = this.range();
    return {
      x: (position) => left + width * position / this.extent,
      y: (v) => top + height * (1 - clamp((v - low) / (high - low), -0.01, 1.01)),
      position: (x) => clamp((x - left) / width, 0, 1) * this.extent,
      low, high, width, height,
    };
  },

  draw() {
    const { canvas } = this;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    pen.font = "12px system-ui, 'DejaVu Sans', sans-serif";
    const style = getComputedStyle(document.documentElement);
    const ink = (name) => style.getPropertyValue(`--${name}`).trim();
    const scales = this.scales();
    this.drawAxes(pen, scales, ink);
    for (const segment of this.segments) {
      segment.lines.forEach((line, method) => {
        if (!this.hidden.has(method)) this.drawLine(pen, scales, segment, line, ink(`m${method % 6}`));
      });
      this.drawMarks(pen, scales, segment, ink("dim"));
    }
    if (this.at) this.drawCursor(pen, scales, ink);
  },

  drawAxes(pen, { x, y, low, high, width, height }, ink) {
    const { left, top } = this.margin;
    const metric = data.metrics[choice.metric];
    const step = niceStep((high - low) / 5);
    const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    pen.textAlign = "right";
    for (let v = Math.ceil(low / step) * step; v <= high; v += step) {
      pen.fillStyle = ink(Math.abs(v) < step / 2 && choice.base >= 0 ? "dim" : "line");
      pen.fillRect(left, Math.round(y(v)), width, 1);
      pen.fillStyle = ink("dim");
      pen.fillText(v.toFixed(decimals).replace("-", "\u2212"), left - 8, y(v) + 4);
    }
    pen.textAlign = "left";
    if (metric && metric.unit) pen.fillText(metric.unit, 8, top + 2);
    for (const segment of this.segments) this.drawFrames(pen, x, segment, top + height, ink);
  },

  drawFrames(pen, x, segment, floor, ink) {
    const span = Math.max(segment.last - segment.first, 1);
    const from = x(segment.start), room = x(segment.start + span) - from;
    const step = Math.max(1, niceStep(span / Math.max(room / 90, 1)));
    if (segment.start > 0) {
      pen.fillStyle = ink("dim");
      pen.fillRect(Math.round(from) - 4, this.margin.top, 1, floor - this.margin.top);
    }
    pen.fillStyle = ink("dim");
    pen.textAlign = "center";
    for (let f = Math.ceil(segment.first / step) * step; f <= segment.last; f += step)
      pen.fillText(String(f), x(segment.start + f - segment.first), floor + 18);
    pen.textAlign = "left";
    if (this.segments.length > 1 && room > 60) {
      pen.save();
      pen.beginPath();
      pen.rect(from, 0, room, 40);
      pen.clip();
      pen.fillText(shotName(segment.shot), from + 4, this.margin.top + 2);
      pen.restore();
    }
  },

  /** Of points that share a column of the screen only the first, last, least and greatest. */
  drawLine(pen, { x, y }, segment, line, colour) {
    pen.strokeStyle = pen.fillStyle = colour;
    pen.lineWidth = 1.6;
    pen.lineJoin = "round";
    pen.beginPath();
    let column = null, ends = [];
    const flush = () => ends.forEach(([px, py]) => pen.lineTo(px, py));
    for (const [frame, v] of line) {
      const px = x(segment.start + frame - segment.first), py = y(v);
      if (Math.round(px) !== column) {
        flush();
        column = Math.round(px);
        ends = [[px, py]];
      } else {
        const heights = [...ends.map((end) => end[1]), py];
        ends = [ends[0], [px, Math.min(...heights)], [px, Math.max(...heights)], [px, py]];
      }
    }
    flush();
    pen.stroke();
    if (line.size === 1) pen.fillRect(ends[0][0] - 2, ends[0][1] - 2, 4, 4);
  },

  drawMarks(pen, { x }, segment, colour) {
    pen.fillStyle = colour;
    const floor = this.canvas.clientHeight - this.margin.bottom;
    for (const moment of data.moments) {
      if (moment.shot !== segment.shot) continue;
      const px = x(segment.start + moment.frame - segment.first);
      pen.beginPath();
      pen.moveTo(px, floor - 7);
      pen.lineTo(px - 4.5, floor);
      pen.lineTo(px + 4.5, floor);
      pen.fill();
    }
  },

  drawCursor(pen, { x, y }, ink) {
    const { segment, frame } = this.at;
    const px = x(segment.start + frame - segment.first);
    pen.fillStyle = ink("dim");
    pen.fillRect(Math.round(px), this.margin.top, 1, this.canvas.clientHeight - this.margin.top - this.margin.bottom);
    segment.lines.forEach((line, method) => {
      if (this.hidden.has(method) || !line.has(frame)) return;
      pen.fillStyle = ink(`m${method % 6}`);
      pen.beginPath();
      pen.arc(px, y(line.get(frame)), 3.5, 0, 7);
      pen.fill();
    });
  },

  /** Put the cursor on the frame nearest to a place of the screen. */
  point(clientX) {
    const position = this.scales().position(clientX - this.canvas.getBoundingClientRect().left);
    let best = null;
    for (const segment of this.segments) for (const frame of segment.frames) {
      const far = Math.abs(segment.start + frame - segment.first - position);
      if (!best || far < best.far) best = { segment, frame, far };
    }
    this.at = best;
    this.draw();
    this.say();
  },

  step(by) {
    const row = this.segments.flatMap((segment) => segment.frames.map((frame) => ({ segment, frame })));
    if (!row.length) return;
    const now = this.at
      ? row.findIndex((o) => o.segment === this.at.segment && o.frame === this.at.frame) : -1;
    this.at = row[clamp(now + by, 0, row.length - 1)];
    this.draw();
    this.say();
  },

  say() {
    const readout = $("readout");
    readout.replaceChildren();
    if (!this.at) return;
    const { segment, frame } = this.at;
    const metric = data.metrics[choice.metric];
    const shot = data.shots.length > 1 ? `${shotName(segment.shot)} ` : "";
    readout.append(make("span", {}, `${shot}frame ${frame}`));
    segment.lines.forEach((line, method) => {
      if (this.hidden.has(method)) return;
      const value = `${written(line.get(frame), metric)} ${metric.unit}`.trim();
      readout.append(make("span", {}, swatch(method), `${data.methods[method]} `, make("b", {}, value)));
    });
  },

  open() {
    if (!this.at) return;
    const { segment, frame } = this.at;
    const near = data.moments.map((moment, place) => ({ moment, place }))
      .filter(({ moment }) => moment.shot === segment.shot)
      .sort((a, b) => Math.abs(a.moment.frame - frame) - Math.abs(b.moment.frame - frame));
    if (!near.length) return;
    viewer.show(near[0].place);
    $("frames").scrollIntoView({ block: "start" });
  },

  start() {
    const { canvas } = this;
    canvas.addEventListener("pointermove", (event) => this.point(event.clientX));
    canvas.addEventListener("click", (event) => { this.point(event.clientX); this.open(); });
    canvas.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -1, ArrowRight: 1, PageUp: -10, PageDown: 10, Home: -1e9, End: 1e9 };
      if (event.key in by) this.step(by[event.key]);
      else if (event.key === "Enter") this.open();
      else return;
      event.preventDefault();
    });
    $("legend").append(...data.methods.map((method, place) => {
      const button = make("button", { type: "button" }, swatch(place), method);
      button.setAttribute("aria-pressed", "true");
      button.onclick = () => {
        if (!this.hidden.delete(place)) this.hidden.add(place);
        button.setAttribute("aria-pressed", String(!this.hidden.has(place)));
        this.draw();
        this.say();
      };
      return button;
    }));
    $("base").append(option(-1, "values"),
      ...data.methods.map((method, place) => option(place, `difference to ${method}`)));
    $("base").onchange = () => choose("base", Number($("base").value));
    $("base").closest("label").hidden = data.methods.length < 2;
    new ResizeObserver(() => this.draw()).observe(canvas.parentElement);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.draw());
  },
};

/** The least of 1, 2, 5 times a power of ten that is no less than `rough`. */
function niceStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= rough * 0.999);
}

// ---- pictures -------------------------------------------------------------------------------

const viewer = {
  place: 0, mode: "swipe", left: 0, right: names.length - 1, zoom: 0, split: 50, swapped: false,
  timer: null, panes: [],

  start() {
    if (!data.moments.length) return;
    for (const side of ["left", "right"]) {
      $(side).append(...names.map((name, place) => option(place, name)));
      $(side).onchange = () => { this[side] = Number($(side).value); this.render(); };
    }
    $("moments").append(...data.moments.map((moment, place) => this.entry(moment, place)));
    for (const radio of all("[name=mode]")) radio.onchange = () => this.setMode(radio.value);
    $("swap").onclick = () => this.exchange();
    $("zoom").onchange = () => this.setZoom(Number($("zoom").value));
    $("rate").oninput = () => this.play(true);
    $("play").onclick = () => this.play(this.timer === null);
    $("stage").addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.fit()).observe($("stage"));
    this.left = names.length > 2 ? 1 : 0;
    this.right = names.length > 2 ? 2 : 1;
    this.show(0);
  },

  get moment() { return data.moments[this.place]; },

  entry(moment, place) {
    const shown = moment.crop ? moment.crop.reference : moment.reference;
    const shot = moment.name ? `${moment.name} ` : "";
    const text = make("span", {}, make("strong", {}, `${shot}frame ${moment.frame}`), make("small", {}, moment.why));
    const button = make("button", { type: "button" }, make("img", { src: shown, alt: "" }), text);
    button.onclick = () => this.show(place);
    return make("li", {}, button);
  },

  show(place) {
    this.place = clamp(place, 0, data.moments.length - 1);
    all("#moments button").forEach((button, k) => button.setAttribute("aria-current", String(k === this.place)));
    const list = $("moments"), item = list.children[this.place];
    list.scrollTo({ left: item.offsetLeft - list.offsetLeft, top: item.offsetTop - list.offsetTop - 60 });
    this.showNumbers();
    this.showCrops();
    this.render();
  },

  showNumbers() {
    const { moment } = this;
    const shot = moment.name ? `${moment.name}, ` : "";
    $("about-frame").replaceChildren(make("b", {}, `${shot}frame ${moment.frame}`), `: ${moment.why}`);
    const head = data.metrics.map((metric) => make("th", { className: "n", scope: "col" }, metric.title));
    const rows = data.methods.map((method, k) => make("tr", {},
      make("th", { scope: "row" }, swatch(k), method),
      ...moment.numbers.map((row) => make("td", { className: "n" }, make(row[k][1] ? "b" : "span", {}, row[k][0])))));
    $("frame-numbers").replaceChildren(make("table", {},
      make("thead", {}, make("tr", {}, make("th", { scope: "col" }, "This frame"), ...head)),
      make("tbody", {}, ...rows)));
  },

  showCrops() {
    const { crop } = this.moment;
    $("crops").closest(".closer").hidden = !crop;
    $("crops").replaceChildren();
    if (!crop) return;
    const [left, top, width, height] = crop.box;
    $("crop-box").textContent = `${width} \u00d7 ${height} pixels from (${left}, ${top}); FLIP map beside`;
    names.forEach((name, source) => {
      const pictures = [source ? crop.tests[source - 1] : crop.reference, source ? crop.heat[source - 1] : null];
      if (pictures.every((picture) => !picture)) return;
      const caption = make("figcaption", {}, ...(source ? [swatch(source - 1)] : []), name);
      $("crops").append(make("figure", {}, caption, ...pictures.map((uri, heat) => this.cropButton(uri, source, heat)).filter(Boolean)));
    });
  },

  cropButton(uri, source, heat) {
    if (!uri) return null;
    const alt = `${heat ? "FLIP map of " : ""}${names[source]}, enlarged`;
    const button = make("button", { type: "button", title: "Show this place in the frame" },
      make("img", { src: uri, alt, className: "pixels" }));
    button.onclick = () => {
      this[source ? "right" : "left"] = source;
      this.render();
      this.goTo(this.moment.crop.box);
    };
    return button;
  },

  setMode(mode) {
    this.mode = mode;
    all("[name=mode]").forEach((radio) => { radio.checked = radio.value === mode; });
    this.swapped = false;
    this.render();
    const calm = matchMedia("(prefers-reduced-motion: reduce)").matches;
    this.play(mode === "flicker" && !calm);
  },

  uri(source, heat) {
    const { moment } = this;
    if (!source) return moment.reference;
    return (heat ? moment.heat : moment.tests)[source - 1];
  },

  /** Build the panes: one with both pictures (swipe, flicker) or one each. */
  render() {
    $("left").value = this.left;
    $("right").value = this.right;
    const heat = this.mode === "heat", apart = heat || this.mode === "side";
    $("scale").hidden = !heat;
    $("flicker-tools").hidden = this.mode !== "flicker";
    const at = this.panes.length ? [this.panes[0].port.scrollLeft, this.panes[0].port.scrollTop] : [0, 0];
    this.panes = apart
      ? [this.pane([this.left], heat), this.pane([this.right], heat)]
      : [this.pane([this.left, this.right], false)];
    $("stage").dataset.mode = this.mode;
    $("stage").replaceChildren(...this.panes.map((pane) => pane.node));
    this.fit();
    for (const { port } of this.panes) port.scrollTo(...at);
    this.compare();
  },

  pane(sources, heat) {
    const images = sources.map((source) => make("img", {
      src: this.uri(source, heat) || "data:,", draggable: false,
      alt: `${heat && source ? "FLIP map of " : ""}${names[source]}, frame ${this.moment.frame}`,
      hidden: !this.uri(source, heat),
    }));
    const picture = make("div", { className: "picture" }, ...images);
    const port = make("div", { className: "port" }, picture);
    const tags = sources.map((source, k) => make("span", { className: `tag ${k ? "r" : "l"}` },
      names[source] + (this.uri(source, heat) ? "" : ": no picture")));
    const node = make("div", { className: "pane" }, port, ...tags);
    const pane = { node, port, picture, images, tags };
    if (this.moment.crop) picture.append(this.outline(this.moment));
    if (this.mode === "swipe") this.addDivider(pane);
    this.addDragging(pane);
    return pane;
  },

  outline({ crop, size }) {
    const mark = make("div", { className: "mark" });
    const percent = crop.box.map((v, k) => `${100 * v / size[k % 2]}%`);
    [mark.style.left, mark.style.top, mark.style.width, mark.style.height] = percent;
    return mark;
  },

  addDivider(pane) {
    pane.divider = make("div", { className: "divider", tabIndex: 0 });
    const about = { role: "slider", "aria-label": "Divider between left and right", "aria-valuemin": 0, "aria-valuemax": 100 };
    for (const [key, value] of Object.entries(about)) pane.divider.setAttribute(key, value);
    pane.node.append(pane.divider);
    const drag = (event) => {
      const { from, width } = this.visible(pane);
      this.split = clamp(100 * (event.clientX - pane.node.getBoundingClientRect().left - from) / width, 0, 100);
      this.compare();
    };
    const grip = (target, allowed) => {
      target.addEventListener("pointerdown", (event) => {
        if (event.button || !allowed()) return;
        target.setPointerCapture(event.pointerId);
        drag(event);
      });
      target.addEventListener("pointermove", (event) => {
        if (target.hasPointerCapture(event.pointerId) && allowed()) drag(event);
      });
    };
    grip(pane.divider, () => true);
    grip(pane.picture, () => !this.zoom);
  },

  addDragging({ port, picture }) {
    picture.addEventListener("pointerdown", (event) => {
      if (!event.button && this.zoom && event.pointerType === "mouse") picture.setPointerCapture(event.pointerId);
    });
    picture.addEventListener("pointermove", (event) => {
      if (this.zoom && picture.hasPointerCapture(event.pointerId)) port.scrollBy(-event.movementX, -event.movementY);
    });
    picture.addEventListener("dblclick", (event) => {
      const box = picture.getBoundingClientRect();
      const spot = [event.clientX - box.left, event.clientY - box.top].map((v) => v * this.moment.size[0] / box.width);
      if (this.zoom) this.setZoom(0);
      else this.goTo([...spot, 0, 0]);
    });
    port.addEventListener("scroll", () => {
      for (const pane of this.panes) if (pane.port !== port) pane.port.scrollTo(port.scrollLeft, port.scrollTop);
      this.compare();
    });
  },

  /** Give the pictures their size: a zoom of 0 fits the pane. */
  fit() {
    const [width, height] = this.moment.size;
    for (const { node, port, picture } of this.panes) {
      const scale = this.zoom || Math.min(node.clientWidth / width, window.innerHeight * 0.74 / height);
      picture.style.width = `${width * scale}px`;
      picture.style.height = `${height * scale}px`;
      picture.classList.toggle("pixels", scale > 1);
      port.classList.toggle("grab", this.zoom > 0);
    }
    this.compare();
  },

  /** The part of the pane, in pixels, where its picture is seen. */
  visible({ node, picture }) {
    const pane = node.getBoundingClientRect(), box = picture.getBoundingClientRect();
    const from = Math.max(box.left - pane.left, 0);
    return { from, width: Math.max(Math.min(box.right, pane.right) - pane.left - from, 1), hidden: pane.left + from - box.left };
  },

  /** Show what the mode shows of the two pictures that lie upon each other. */
  compare() {
    const [pane] = this.panes;
    if (!pane || pane.images.length < 2) return;
    const [under, over] = pane.images;
    if (this.mode === "swipe") {
      const { from, width, hidden } = this.visible(pane);
      const place = width * this.split / 100;
      over.style.clipPath = `inset(0 0 0 ${hidden + place}px)`;
      under.style.clipPath = `inset(0 calc(100% - ${hidden + place}px) 0 0)`;
      pane.divider.style.left = `${from + place}px`;
      pane.divider.setAttribute("aria-valuenow", Math.round(this.split));
    } else {
      under.style.visibility = pane.tags[0].style.visibility = this.swapped ? "hidden" : "visible";
      over.style.visibility = pane.tags[1].style.visibility = this.swapped ? "visible" : "hidden";
    }
  },

  flip() {
    this.swapped = !this.swapped;
    this.compare();
  },

  play(on) {
    clearInterval(this.timer);
    this.timer = on ? setInterval(() => this.flip(), 1000 / Number($("rate").value)) : null;
    $("play").textContent = on ? "Pause" : "Play";
    $("rate-text").textContent = $("rate").value;
  },

  exchange() {
    [this.left, this.right] = [this.right, this.left];
    this.render();
  },

  setZoom(zoom) {
    const [pane] = this.panes, { port, picture } = pane;
    const middle = [(port.scrollLeft + port.clientWidth / 2) / picture.clientWidth,
      (port.scrollTop + port.clientHeight / 2) / picture.clientHeight];
    this.zoom = zoom;
    $("zoom").value = zoom;
    this.fit();
    port.scrollTo(middle[0] * picture.clientWidth - port.clientWidth / 2, middle[1] * picture.clientHeight - port.clientHeight / 2);
    this.compare();
  },

  /** Enlarge and bring a box of the frame to the middle. */
  goTo([left, top, width, height]) {
    if (this.zoom < 2) this.setZoom(4);
    const { port } = this.panes[0];
    port.scrollTo((left + width / 2) * this.zoom - port.clientWidth / 2, (top + height / 2) * this.zoom - port.clientHeight / 2);
  },

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const zooms = [...$("zoom").options].map((o) => Number(o.value));
    const scale = (by) => this.setZoom(zooms[clamp(zooms.indexOf(this.zoom) + by, 0, zooms.length - 1)]);
    const move = (by) => {
      if (this.mode !== "swipe") return false;
      this.split = clamp(this.split + by * (event.shiftKey ? 10 : 2), 0, 100);
      return this.compare();
    };
    const actions = {
      ArrowLeft: () => move(-1), ArrowRight: () => move(1), Home: () => move(-50), End: () => move(50),
      " ": () => (this.mode === "flicker" ? (this.play(false), this.flip()) : this.exchange()),
      "+": () => scale(1), "=": () => scale(1), "-": () => scale(-1), x: () => this.exchange(),
      n: () => this.show(this.place + 1), p: () => this.show(this.place - 1),
      1: () => this.setMode("swipe"), 2: () => this.setMode("flicker"), 3: () => this.setMode("side"), 4: () => this.setMode("heat"),
    };
    const action = Object.hasOwn(actions, event.key) && actions[event.key];
    if (!action) return;
    const held = document.activeElement.classList.contains("divider");
    if (action() === false) return;
    event.preventDefault();
    if (held && !document.activeElement.classList.contains("divider"))
      ($("stage").querySelector(".divider") || $("stage")).focus({ preventScroll: true });
  },
};

// ---- strips ---------------------------------------------------------------------------------

function showStrips() {
  for (const strip of data.strips) {
    const height = `${clamp(2 * strip.height, 90, 400)}px`;
    const where = `${strip.name ? `${strip.name}, ` : ""}row ${strip.row}`;
    const rows = names.map((name, source) => {
      const uri = source ? strip.tests[source - 1] : strip.reference;
      if (!uri) return null;
      const image = make("img", { src: uri, alt: `${where} of ${name} over time`, className: "pixels" });
      image.style.height = height;
      return make("div", {}, make("span", {}, ...(source ? [swatch(source - 1)] : []), name), image);
    });
    $("strip-list").append(make("div", { className: "strip" }, make("h3", {}, where), ...rows.filter(Boolean)));
  }
}

fillChoices();
plot.start();
choose("metric", 0);
viewer.start();
showStrips();
})();
