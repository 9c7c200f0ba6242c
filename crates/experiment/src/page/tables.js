// Tables, plots and words, and the beginning.

const spread = (value) => {
  const cell = make("td", value ? digits(value.median) : "–");
  cell.dataset.value = value ? value.median : "";
  if (value && value.low < value.high) cell.append(make("span", ` ${digits(value.low)}…${digits(value.high)}`, "range"));
  return cell;
};
const percent = (value) => (100 * value).toFixed(2);
const estimate = (value, half, shown, unit, alarm) => {
  const known = value && half;
  const cell = make("td", known ? `${shown(value.median)} ± ${shown(half.median)}${unit}` : "–");
  cell.dataset.value = known ? value.median : "";
  if (alarm) {
    cell.classList.add("alarm");
    cell.title = "The method is unbiased and yet differs from the reference by more than chance allows: one of them is wrong.";
  }
  return cell;
};
const text = (value) => {
  const cell = make("td", value, "text");
  cell.dataset.value = value;
  return cell;
};

function table(target, heads, rows) {
  const head = make("tr");
  heads.forEach((name, column) => {
    const th = make("th", name, rows.length && rows[0][column].className.includes("text") ? "text" : undefined);
    let rising = true;
    th.onclick = () => {
      const value = (row) => row.children[column].dataset.value;
      const body = target.tBodies[0];
      const sorted = [...body.rows].sort((a, b) => {
        const [x, y] = [value(a), value(b)];
        if (x === "" || y === "") return (x === "") - (y === "");
        const order = isNaN(x) || isNaN(y) ? x.localeCompare(y) : x - y;
        return rising ? order : -order;
      });
      rising = !rising;
      body.append(...sorted);
    };
    head.append(th);
  });
  const body = make("tbody");
  rows.forEach((cells) => {
    const row = make("tr");
    row.append(...cells);
    body.append(row);
  });
  const thead = make("thead");
  thead.append(head);
  target.replaceChildren(thead, body);
}

function begin() {
  byId("title").textContent = results.title;
  byId("about").textContent = results.about;
  byId("quick").hidden = !results.quick;
  const m = results.machine;
  byId("origin").textContent = `${m.cpu}, ${m.threads} threads; version ${m.version}, commit ${m.commit}.`;
  table(byId("figures"),
    ["scene", "lights", "method", "budget", "spp", "time [s]", "CPU [s]", "Mrays", "relmse", "mape", "HDR-FLIP", "FLIP", "bias", "local bias", "relmse × CPU s"],
    results.series.map((s) => [
      text(s.scene), text(s.lights), text(s.label), text(s.budget), spread(s.spp), spread(s.seconds), spread(s.cpu_seconds),
      spread(s.mrays), spread(s.relmse), spread(s.mape), spread(s.hdr_flip), spread(s.flip),
      estimate(s.bias, s.bias_95, percent, " %", s.suspicious), estimate(s.local_bias, s.local_bias_95, digits, ""), spread(s.product),
    ]));
  byId("failed").hidden = results.failures.length === 0;
  byId("failures").replaceChildren(...results.failures.map((message) => make("li", message)));
  byId("plots").append(...results.plots.map((plot) => {
    const figure = make("figure"), image = make("img"), link = make("a", "PNG");
    image.src = `plots/${plot.name}.svg`;
    image.alt = plot.caption;
    image.loading = "lazy";
    link.href = `plots/${plot.name}.png`;
    const caption = make("figcaption", `${plot.caption} `);
    caption.append(link);
    figure.append(image, caption);
    return figure;
  }));
  byId("animation").hidden = results.animations.length === 0;
  table(byId("flicker"), ["scene", "lights", "method", "budget", "per pixel", "blocks of 8 × 8", "pattern"],
    results.animations.map((a) => [text(a.scene), text(a.lights), text(a.label), text(a.budget),
      spread({ median: a.pixel }), spread({ median: a.block }), spread(a.pattern === null ? null : { median: a.pattern })]));
  byId("previews").append(...results.animations.map((a) => {
    const figure = make("figure"), image = make("img");
    image.src = `animations/${a.preview}`;
    image.alt = `${a.scene}, ${a.lights}, ${a.label}, ${a.budget}: animated`;
    figure.append(image, make("figcaption", `${a.label}, ${a.budget}`));
    return figure;
  }));
  byId("comparer").hidden = results.places.length === 0;
  if (results.places.length) {
    byId("place").replaceChildren(...results.places.map((p, index) => {
      const option = make("option", `${p.scene}, ${p.lights}`);
      option.value = index;
      return option;
    }));
    choosePlace(0);
  }
}

begin();
