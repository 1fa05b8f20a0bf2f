// Strips over time, and the start.
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
