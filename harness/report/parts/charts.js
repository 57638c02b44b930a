// A page of charts: lines, points, bars and bands over any axes. README.md describes the data.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const of = (id) => document.getElementById(id);
  const data = JSON.parse(of("data").textContent);
  const NEAR = 40; // px from a point at which it answers
  const INCH = 92; // px for an inch of the picture
  const LETTER = 6.3; // px, of the axes' names
  const SPACE = { x: 40, y: 16 }; // px that a number on an axis takes
  const DIGITS = [ // of a decade that may have numbers, and how close they then are, as a share of the decade
    { of: [1, 2, 3, 4, 5, 6, 7, 8, 9], closest: Math.log10(10 / 9) }, { of: [1, 2, 3, 5, 7], closest: Math.log10(7 / 5) },
    { of: [1, 2, 5], closest: Math.log10(2) }, { of: [1, 3], closest: Math.log10(3) },
  ];
  const WHOLE = Array.from({ length: 10 }, (_, power) => [1, 2, 5].map((digit) => digit * 10 ** power)).flat(); // steps
  const number = (value, digits = 5) => String(Number(Number(value).toPrecision(digits)));
  const colour = (name) => (name && name[0] !== "#" && name !== "none" ? canine.colour(name) : name);

  // A name at a place of an axis that has names, else the number.
  const spoken = function (scale, value) {
    const near = (scale.names || []).reduce((best, [place, text]) => {
      const off = Math.abs(place - value);
      return off <= 0.5 && off < best.off ? { off, text } : best;
    }, { off: Infinity, text: null });
    return near.text === null ? number(value) : near.text;
  };
  // Of an axis' label "speed [m/s]; grey: without GPS" the unit, and what it is the unit of.
  const unit = (label) => (label.includes("[") ? label.slice(label.indexOf("[") + 1, label.indexOf("]")) : "");
  const plain = (label) => label.replace(`[${unit(label)}]`, "").split(";")[0].trim();

  // A sign about a place, as matplotlib names them.
  function sign(context, kind, x, y, size, hollow) {
    const r = size / 2;
    context.beginPath();
    if ("x+|_".includes(kind)) {
      const lines = kind === "_" ? [[-r, 0, r, 0]] : kind === "x" ? [[-r, -r, r, r], [-r, r, r, -r]] : kind === "|" ? [[0, -2 * r, 0, 2 * r]] : [[-r, 0, r, 0], [0, -r, 0, r]];
      for (const [a, b, c, d] of lines) context.moveTo(x + a, y + b), context.lineTo(x + c, y + d);
      context.stroke();
      return;
    }
    if (kind === "D" || kind === "s") {
      const k = kind === "D" ? 1.25 * r : r;
      if (kind === "D") context.moveTo(x, y - k), context.lineTo(x + k, y), context.lineTo(x, y + k), context.lineTo(x - k, y), context.closePath();
      else context.rect(x - k, y - k, 2 * k, 2 * k);
    } else context.arc(x, y, kind === "." ? 0.6 * r : r, 0, 2 * Math.PI);
    if (hollow) context.stroke();
    else context.fill();
  }

  // What stands for an entry of a legend.
  function swatch(entry) {
    const size = 22, canvas = canine.element("canvas", { class: "swatch-sign", width: 2 * size, height: size, "aria-hidden": "true" });
    const paint = function () {
      const context = canvas.getContext("2d");
      context.clearRect(0, 0, 2 * size, size);
      context.strokeStyle = context.fillStyle = colour(entry.colour);
      context.lineWidth = 2 * Math.max(entry.width, 1);
      context.setLineDash(entry.dash.map((part) => 2 * part));
      context.beginPath();
      if (entry.sign === "box") context.fillRect(0, 3, 2 * size, size - 6);
      else if (entry.width) {
        context.moveTo(0, size / 2);
        context.lineTo(2 * size, size / 2);
        context.stroke();
      }
      context.setLineDash([]);
      if (entry.sign && entry.sign !== "box") sign(context, entry.sign, size, size / 2, 12, entry.hollow);
    };
    paint();
    canine.onRestyle(paint);
    return canvas;
  }
  const legend = (entries) => canine.element("div", { class: "legend" },
    ...entries.map((entry) => canine.element("span", {}, swatch(entry), entry.label)));

  function draw(u, marks) {
    const { left, top, width, height } = u.bbox, context = u.ctx, dpr = devicePixelRatio;
    const at = (value, scale) => u.valToPos(value, scale, true);
    context.save();
    context.beginPath();
    context.rect(left, top, width, height);
    context.clip();
    for (const mark of marks) {
      context.strokeStyle = context.fillStyle = colour(mark.colour || "ink");
      context.lineWidth = Math.max(mark.width || 1, 1) * dpr;
      context.setLineDash((mark.dash || []).map((part) => part * dpr));
      if (mark.kind === "box") {
        const [x, end] = mark.x ? mark.x.map((v) => at(v, "x")) : [left, left + width];
        const [y, below] = mark.y ? mark.y.map((v) => at(Math.max(v, u.scales.y.distr === 3 ? u.scales.y.min : v), "y")) : [top, top + height];
        const start = mark.x && u.scales.x.distr === 3 && mark.x[0] <= 0 ? left : x;
        context.globalAlpha = mark.x && mark.y ? 0.75 : 0.45;
        context.fillRect(Math.min(start, end), Math.min(y, below), Math.max(Math.abs(end - start), dpr), Math.max(Math.abs(below - y), dpr));
        context.globalAlpha = 1;
      } else if (mark.kind === "level") {
        context.beginPath();
        if (mark.x === null) context.moveTo(left, at(mark.y, "y")), context.lineTo(left + width, at(mark.y, "y"));
        else context.moveTo(at(mark.x, "x"), top), context.lineTo(at(mark.x, "x"), top + height);
        context.stroke();
      } else if (mark.kind === "line") {
        if (mark.width) {
          context.beginPath();
          let open = false;
          mark.x.forEach((x, i) => {
            if (x === null || mark.y[i] === null) return void (open = false);
            if (open) context.lineTo(at(x, "x"), at(mark.y[i], "y"));
            else context.moveTo(at(x, "x"), at(mark.y[i], "y"));
            open = true;
          });
          context.stroke();
        }
        context.setLineDash([]);
        context.lineWidth = 1.4 * dpr;
        if (mark.sign) mark.x.forEach((x, i) => x !== null && mark.y[i] !== null && sign(context, mark.sign, at(x, "x"), at(mark.y[i], "y"), 7 * dpr, mark.hollow));
      } else {
        context.font = `${11 * dpr}px system-ui, sans-serif`;
        context.textAlign = mark.kind === "words" ? "center" : "left";
        const x = mark.kind === "words" ? left + width / 2 : at(mark.x, "x"), y = mark.kind === "words" ? top + height / 2 : at(mark.y, "y") - 3 * dpr;
        mark.text.split("\n").forEach((line, i) => canine.write(context, line, x, y + i * 14 * dpr));
      }
    }
    context.restore();
  }

  // The places of a logarithmic axis: 1 to 9 of each power of ten. uPlot would count from the axis' own begin.
  function decades(u, index, least, most) {
    const all = [];
    for (let power = 10 ** Math.floor(Math.log10(least)); power <= most; power *= 10) {
      for (let digit = 1; digit < 10; digit++) all.push(Number((digit * power).toPrecision(12)));
    }
    return all.filter((place) => place >= least && place <= most);
  }
  // Of these places those with a number, by the digits for which a decade has room: uPlot looks at upright axes alone.
  function numbered(u, places, index) {
    const name = index ? "y" : "x", decade = Math.abs(u.valToPos(10, name) - u.valToPos(1, name));
    const digits = DIGITS.find(({ closest }) => closest * decade > SPACE[name]), every = Math.ceil(SPACE[name] / decade);
    return places.map((place) => {
      const power = Math.floor(Math.log10(place) + 1e-9), digit = Math.round(place / 10 ** power);
      return (digits ? digits.of.includes(digit) : digit === 1 && power % every === 0) ? place : null;
    });
  }

  // The ranges of both axes with one scale: a metre north is as long as one east.
  function evened(u, [x, y]) {
    const room = [u.bbox.width || 1, u.bbox.height || 1], each = Math.max((x[1] - x[0]) / room[0], (y[1] - y[0]) / room[1]);
    return [x, y].map(([low, high], i) => [(low + high - each * room[i]) / 2, (low + high + each * room[i]) / 2]);
  }

  function chart(of, element, heading) {
    const body = canine.element("div", { class: "chart-body", tabindex: 0, role: "img",
      "aria-label": [of.title, plain(of.y.label), "over", plain(of.x.label)].filter(Boolean).join(" ") });
    let told = null; // the mark and the point that the tip is about
    const tip = canine.element("div", { class: "tip", role: "status" }), ring = canine.element("div", { class: "ring" });
    const box = canine.element("div", { class: "chart" }, ...(of.title ? [canine.element(heading, {}, of.title)] : []),
      ...(of.legend.length ? [legend(of.legend)] : []), body);
    element.append(box);
    if (of.place) {
      box.style.setProperty("--row", `${of.place[0] + 1} / ${of.place[1] + 2}`);
      box.style.setProperty("--column", `${of.place[2] + 1} / ${of.place[3] + 2}`);
    }
    const lines = { stroke: () => canine.colour("soft"), grid: { stroke: () => canine.colour("grid"), width: 1 },
      ticks: { stroke: () => canine.colour("grid"), width: 1, size: 4 }, font: "11px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    const axis = (scale) => (scale.names ? {
      ...lines, label: scale.label || undefined,
      splits: (u, i, least, most) => scale.names.map(([place]) => place).filter((place) => place >= least && place <= most),
      values: (u, places) => places.map((place) => spoken(scale, place)),
    } : { ...lines, ...(scale.log ? { splits: decades, filter: numbered } : scale.whole ? { incrs: WHOLE } : {}), label: scale.label || undefined,
      values: (u, places) => places.map((place) => (place === null ? "" : number(place, 3))) });
    const last = of.x.names ? of.x.names.at(-1)[1] : number(of.x.range[1], 3); // stands half beyond the axis
    const longest = Math.max(0, ...(of.y.names || []).map(([, text]) => text.length));
    const names = of.y.names ? 20 * of.y.names.length : 0;
    const height = () => Math.max(INCH * of.height, 220, names + 60);
    const scale = (side) => ({ time: false, distr: side.log ? 3 : 1, dir: side.turned ? -1 : 1, range: (u, least, most) => [least, most] });
    const whole = () => [of.x.range, of.y.range];
    const u = new uPlot({
      width: Math.max(body.clientWidth, 150), height: height(), legend: { show: false }, padding: [8, Math.max(12, (LETTER / 2) * last.length), 0, 0],
      scales: { x: scale(of.x), y: scale(of.y) }, series: [{}, { show: true, stroke: "transparent", points: { show: false } }],
      axes: [{ ...axis(of.x), size: 30, labelSize: 18, gap: 2 },
        { ...axis(of.y), size: of.y.names ? Math.min(LETTER * longest, 190) + 14 : 56, labelSize: 18, gap: 4 }],
      cursor: { x: false, y: false, points: { show: false }, drag: { x: true, y: true, uni: 20 },
        bind: { dblclick: () => () => showAll() } },
      hooks: { draw: [(self) => draw(self, of.marks)], setCursor: [(self) => self.cursor.event && point(self.cursor.left, self.cursor.top)],
        setScale: [() => tell(null)] },
    }, [of.x.range, of.y.range], body);
    u.over.append(ring, tip);
    function showAll() {
      const [x, y] = of.equal ? evened(u, whole()) : whole();
      u.batch(() => {
        u.setScale("x", { min: x[0], max: x[1] });
        u.setScale("y", { min: y[0], max: y[1] });
      });
    }
    showAll();

    // The nearest point tells its numbers; a bar tells its own where the cursor is in it.
    function point(left, top) {
      if (left < 0) return tell(null);
      let best = { off: NEAR * NEAR };
      of.marks.forEach((mark, number) => {
        if (mark.kind === "line") {
          for (let i = 0; i < mark.x.length; i++) {
            if (mark.x[i] === null || mark.y[i] === null) continue;
            const off = (u.valToPos(mark.x[i], "x") - left) ** 2 + (u.valToPos(mark.y[i], "y") - top) ** 2;
            if (off < best.off) best = { off, number, i };
          }
        } else if (mark.kind === "box" && mark.x && mark.y) {
          const x = u.posToVal(left, "x"), y = u.posToVal(top, "y");
          if (x >= mark.x[0] && x <= mark.x[1] && y >= mark.y[0] && y <= mark.y[1] && best.off > 64) best = { off: 64, number, i: 0 };
        }
      });
      tell(best.number === undefined ? null : best);
    }
    function tell(next) {
      told = next;
      tip.hidden = ring.hidden = !next;
      if (!next) return;
      const mark = of.marks[next.number], [x, y] = place(mark, next.i);
      const left = u.valToPos(x, "x"), top = u.valToPos(y, "y");
      const said = (side, value) => `${plain(side.label) || (side === of.x ? "x" : "y")} ${spoken(side, value)} ${unit(side.label)}`.trim();
      tip.replaceChildren(...(mark.name ? [canine.element("strong", {}, mark.name), canine.element("br", {})] : []),
        said(of.x, x), canine.element("br", {}), said(of.y, y));
      ring.style.left = left + "px";
      ring.style.top = top + "px";
      const isRight = left > u.over.clientWidth / 2, isLow = top > u.over.clientHeight / 2;
      tip.style.left = isRight ? "" : left + 10 + "px";
      tip.style.right = isRight ? u.over.clientWidth - left + 10 + "px" : "";
      tip.style.top = isLow ? "" : top + 10 + "px";
      tip.style.bottom = isLow ? u.over.clientHeight - top + 10 + "px" : "";
    }
    // Where a mark has its point: of a bar the end, in the middle of its breadth.
    function place(mark, i) {
      if (mark.kind === "line") return [mark.x[i], mark.y[i]];
      const end = (side) => (Math.abs(side[0]) > Math.abs(side[1]) ? side[0] : side[1]), middle = (side) => (side[0] + side[1]) / 2;
      const lies = of.y.names && !of.x.names;
      return lies ? [end(mark.x), middle(mark.y)] : [middle(mark.x), end(mark.y)];
    }
    const answering = of.marks.map((mark, i) => i).filter((i) => of.marks[i].kind === "line" || (of.marks[i].kind === "box" && of.marks[i].x && of.marks[i].y));
    const next = function (from, way) {
      const mark = of.marks[from.number], count = mark.kind === "line" ? mark.x.length : 1;
      for (let i = from.i + way; i >= 0 && i < count; i += way) if (place(mark, i).every(canine.isNumber)) return { number: from.number, i };
      return from;
    };
    body.addEventListener("keydown", (event) => {
      const ways = { ArrowRight: [1, 0], ArrowLeft: [-1, 0], ArrowDown: [0, 1], ArrowUp: [0, -1] }, way = ways[event.key];
      if (!way || !answering.length) return;
      event.preventDefault();
      if (!told) return void tell(next({ number: answering[0], i: -1 }, 1));
      const row = answering.indexOf(told.number);
      if (way[0]) tell(next(told, way[0]));
      else tell(next({ number: answering[(row + way[1] + answering.length) % answering.length], i: -1 }, 1));
    });
    body.addEventListener("blur", () => tell(null));
    canine.onRestyle(() => u.redraw(false, true));
    new ResizeObserver(() => {
      const width = body.clientWidth;
      if (!width || width === u.width) return;
      u.setSize({ width, height: height() });
      if (of.equal) showAll();
    }).observe(body);
  }

  for (const figure of data.figures) {
    const section = canine.element("section", { class: "figure" });
    if (figure.title) section.append(canine.element("h2", {}, figure.title));
    if (figure.legend.length) section.append(legend(figure.legend));
    of("charts").append(section);
    for (const charts of figure.grids) {
      const grid = canine.element("div", { class: "charts" });
      const columns = Math.max(...charts.map(({ place }) => (place ? place[3] + 1 : 1)));
      grid.style.setProperty("--columns", columns);
      section.append(grid);
      for (const one of charts) chart(one, grid, figure.title ? "h3" : "h2");
    }
  }
  of("tools").append(canine.themeSwitch());
  document.addEventListener("keydown", (event) => {
    if (event.key.toLowerCase() === "t" && !event.ctrlKey && !event.metaKey && !event.altKey) canine.turnTheme();
  });
})();
