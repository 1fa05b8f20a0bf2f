// Pictures of single frames, compared.
const viewer = {
  place: 0, mode: "swipe", left: 0, right: 0, zoom: 0, split: 50, swapped: false,
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
    [this.left, this.right] = data.pair.map((method) => method + 1);
    this.show(0);
  },

  get moment() { return data.moments[this.place]; },

  entry(moment, place) {
    const shown = moment.crop ? moment.crop.reference : moment.reference;
    const shot = moment.name ? [make("small", {}, moment.name)] : [];
    const text = make("span", {}, make("strong", {}, `frame ${moment.frame}`), ...shot, make("small", {}, moment.why));
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
      if (source !== this.left && source !== this.right) this[source ? "right" : "left"] = source;
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
      this.follow(port);
      this.compare();
    });
  },

  /** Scroll the other panes as one was; events of panes that only followed move nobody. */
  follow(port) {
    const leader = this.panes.find((pane) => pane.port === port);
    const at = [port.scrollLeft, port.scrollTop];
    if (!leader || String(leader.followed) === String(at)) return;
    for (const pane of this.panes) if (pane !== leader) {
      pane.port.scrollTo(...at);
      pane.followed = [pane.port.scrollLeft, pane.port.scrollTop];
    }
  },

  /** Give the pictures their size: a zoom of 0 fits the pane. */
  fit() {
    const [width, height] = this.moment.size;
    for (const { node, port, picture } of this.panes) {
      const scale = this.zoom || Math.min(node.clientWidth / width, window.innerHeight * 0.74 / height);
      // whole pixels: a fraction more than the pane would bring scroll bars
      picture.style.width = `${Math.floor(width * scale)}px`;
      picture.style.height = `${Math.floor(height * scale)}px`;
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
