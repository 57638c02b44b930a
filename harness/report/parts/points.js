// A page of many trials: a point for each setting; its numbers, and the trials behind it by seed.
(function () {
  "use strict";
  const of = (id) => document.getElementById(id);
  const data = JSON.parse(of("data").textContent), { points, axis, grids } = data;
  const shown = { point: -1 };
  const percent = (share) => (canine.isNumber(share) ? (100 * share).toFixed(1) + " %" : "\u2013");

  // The numbers of a point, and its trials: a choice of one shows the scenario that runs it again.
  const seeds = canine.element("select", { size: 12, "aria-label": "trials by seed" });
  const again = canine.element("pre", { tabindex: 0, "aria-label": "scenario of the trial" });
  const filter = canine.element("select", { "aria-label": "which trials" });
  for (const [value, text] of [["", "all trials"], ["1", "successes"], ["0", "others"]]) {
    filter.append(canine.element("option", { value }, text));
  }
  const trial = (point, number) => {
    const ticks = point.ticks[number];
    return `seed ${point.seed + number}: ` + (ticks ? "success after " + (ticks * data.tick).toFixed(2) + " s" : "no success");
  };
  function list() {
    const point = points[shown.point];
    seeds.replaceChildren();
    again.textContent = "";
    point.ticks.forEach((ticks, number) => {
      if (filter.value && Boolean(ticks) !== (filter.value === "1")) return;
      seeds.append(canine.element("option", { value: number }, trial(point, number)));
    });
  }
  filter.addEventListener("change", list);
  seeds.addEventListener("change", () => {
    const point = points[shown.point], number = Number(seeds.value), types = point.scenarios;
    if (!types.length) return;
    const [before, after] = types[number % types.length];
    again.textContent = `# canine run trial.toml${point.options}, with this as trial.toml\n${before}${point.seed + number}${after}`;
  });
  function show(index) {
    if (index === shown.point || !points[index]) return;
    shown.point = index;
    const point = points[index], table = canine.element("table", {});
    for (const [name, text] of point.numbers) {
      table.append(canine.element("tr", {}, canine.element("th", { scope: "row" }, name), canine.element("td", {}, text)));
    }
    of("point").replaceChildren(canine.element("h2", {}, point.label), table,
      canine.element("div", { class: "trials" }, filter, seeds, again));
    list();
    for (const button of document.querySelectorAll("[data-point]")) {
      button.setAttribute("aria-pressed", String(Number(button.dataset.point) === index));
    }
    charts.forEach((place) => place());
  }

  // Over one parameter: success with its interval, and the mean time.
  const charts = [];
  function chart(title, columns, unit, colours, range) {
    const body = canine.element("div", { role: "img", "aria-label": title });
    of("charts").append(canine.element("div", { class: "plot" }, canine.element("h3", {}, title), body));
    const cursor = canine.element("div", { class: "time-cursor" });
    const lines = { stroke: () => canine.colour("soft"), grid: { stroke: () => canine.colour("grid"), width: 1 },
      ticks: { stroke: () => canine.colour("grid"), width: 1, size: 4 } };
    const place = (self) => {
      if (shown.point >= 0) cursor.style.left = self.valToPos(axis.values[shown.point], "x") + "px";
    };
    const u = new uPlot({
      width: Math.max(of("charts").clientWidth, 200), height: 260, legend: { show: false },
      scales: { x: { time: false }, y: { range: (self, least, most) => range || [least - 0.1 * (most - least || 1), most + 0.1 * (most - least || 1)] } },
      series: [{}, ...colours.map((colour, i) => ({ stroke: () => canine.colour(colour), width: i ? 1 : 2, dash: i ? [4, 3] : undefined,
        points: { show: !i, size: 7, fill: () => canine.colour(colour) } }))],
      bands: columns.length > 2 ? [{ series: [2, 3], fill: () => canine.colour("sigma") }] : [],
      axes: [{ ...lines, label: axis.label, size: 30, labelSize: 22, stroke: () => canine.colour("soft") }, { ...lines, size: 60 }],
      cursor: { x: false, y: false, points: { show: false } },
      hooks: { draw: [place], setCursor: [(self) => self.cursor.event && self.cursor.idx !== null && show(self.cursor.idx)] },
    }, [axis.values, ...columns], body);
    u.over.append(cursor);
    charts.push(() => place(u));
    canine.onRestyle(() => u.redraw(false, true));
    new ResizeObserver(() => {
      const width = of("charts").clientWidth;
      if (width && width !== u.width) {
        u.setSize({ width, height: 260 });
      }
    }).observe(of("charts"));
  }
  if (axis && axis.values.length > 1) {
    const column = (name) => points.map((point) => point[name]);
    chart("success rate [%] with its 95 % interval", ["rate", "high", "low"].map((name) => column(name).map((v) => v === null ? null : 100 * v)),
      "%", ["none", "none", "none"], [0, 100]);
    chart("mean time of the successful trials [s]", [column("time")], "s", ["estimate"], null);
  }

  // Over two: a table of success rates, the better the fuller the bar.
  for (const { title, row, column, rows, columns, cells } of grids) {
    const table = canine.element("table", { class: "grid-table" }, canine.element("caption", {}, title));
    table.append(canine.element("tr", {}, canine.element("th", { scope: "col" }, `${row} \\ ${column}`),
      ...columns.map((name) => canine.element("th", { scope: "col" }, name))));
    rows.forEach((name, i) => {
      const line = canine.element("tr", {}, canine.element("th", { scope: "row" }, name));
      cells[i].forEach((index) => {
        const point = points[index], button = canine.element("button", { type: "button", "data-point": index, title: point.label }, percent(point.rate));
        button.style.backgroundImage = `linear-gradient(90deg, var(--bar) ${100 * (point.rate || 0)}%, transparent 0)`;
        for (const event of ["click", "focus", "mouseenter"]) button.addEventListener(event, () => show(index));
        line.append(canine.element("td", {}, button));
      });
      table.append(line);
    });
    of("grids").append(table);
  }
  const best = points.reduce((kept, point, i) => ((point.rate || 0) > ((points[kept] || {}).rate || 0) ? i : kept), 0);
  show(best);
  of("tools").append(canine.themeSwitch());
  document.addEventListener("keydown", (event) => {
    if (event.target.closest("select, pre, button") || !["ArrowLeft", "ArrowRight"].includes(event.key)) return;
    show(Math.min(Math.max(shown.point + (event.key === "ArrowRight" ? 1 : -1), 0), points.length - 1));
  });
})();
