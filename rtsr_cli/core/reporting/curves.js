// Curves over the frames.
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
        if (!this.hidden.has(method)) this.drawLine(pen, scales, segment, line, ink(`m${method % COLOURS}`));
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
      pen.fillStyle = ink(`m${method % COLOURS}`);
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
