// Panels over time by uPlot: one time cursor, zoom in common, values at the cursor, bands and marks.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const AXIS = 4.4, RIGHT = 12; // rem, px: style.css has the same for the strip
  const STEPS = [0.01, 0.1, 0.5, 1, 2, 5, 10, 20, 30, 60, 120, 300, 600, 1800, 3600]; // s
  const HATCH = { order: 1, lost: -1, fault: 2 }; // direction of the lines; 2 is both

  function hatch(context, kind, colour) {
    const tile = document.createElement("canvas"), brush = tile.getContext("2d");
    tile.width = tile.height = 12;
    brush.fillStyle = brush.strokeStyle = colour;
    brush.fillRect(0, 0, 12, 12);
    brush.beginPath();
    if (HATCH[kind] > 0) for (const x of [-12, 0, 12]) brush.moveTo(x, 0), brush.lineTo(x + 12, 12);
    if (HATCH[kind] === -1 || HATCH[kind] === 2) for (const x of [-12, 0, 12]) brush.moveTo(x + 12, 0), brush.lineTo(x, 12);
    brush.stroke();
    return context.createPattern(tile, "repeat");
  }
  // The times at an axis, as precise as its steps.
  const times = (u, splits, index, space, step) =>
    splits.map((time) => canine.clock(time, step < 0.1 ? 2 : step < 1 ? 1 : 0));
  // Angles that pass from one end to the other leave a gap instead of a line across.
  const unwrapped = (values, turn) =>
    values.map((value, row) => (row && canine.isNumber(value) && Math.abs(value - values[row - 1]) > turn / 2 ? null : value));
  // Words over lines: a border keeps what lies under them from striking them out.
  canine.write = function (context, text, x, y) {
    context.strokeStyle = canine.colour("paper");
    context.lineWidth = 4 * devicePixelRatio;
    context.setLineDash([]);
    context.strokeText(text, x, y);
    context.fillText(text, x, y);
  };
  const shownValues = (values, unit) => values.map((value) => canine.toShown(value, unit));

  // Panels in an element: add(panel), setBands(bands), setMarks(marks), resize by themselves.
  canine.plots = function (element, timeline) {
    const panels = [];
    let bands = [], marks = [];
    const rem = parseFloat(getComputedStyle(document.documentElement).fontSize);

    function drawBehind(u) {
      const { left, top, width, height } = u.bbox, context = u.ctx;
      context.save();
      context.beginPath();
      context.rect(left, top, width, height);
      context.clip();
      for (const { from, until, kind } of bands) {
        const x = u.valToPos(from, "x", true), end = u.valToPos(until, "x", true);
        context.fillStyle = hatch(context, kind, canine.colour(kind));
        context.fillRect(x, top, Math.max(end - x, 2 * devicePixelRatio), height);
        for (const edge of [x, end]) context.fillRect(edge, top, devicePixelRatio, height); // bands may touch
      }
      context.lineWidth = devicePixelRatio;
      for (const { time, kind } of marks) {
        const x = u.valToPos(time, "x", true);
        context.strokeStyle = canine.colour(kind === "waypoint" ? "waypoint" : "caution");
        context.setLineDash(kind === "waypoint" ? [2 * devicePixelRatio, 3 * devicePixelRatio] : []);
        context.beginPath();
        context.moveTo(x, top);
        context.lineTo(x, kind === "waypoint" ? top + height : top + 9 * devicePixelRatio);
        context.stroke();
      }
      context.restore();
    }
    function drawLevels(u, levels, unit) {
      const { left, top, width, height } = u.bbox, context = u.ctx;
      context.save();
      context.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
      context.textAlign = "right";
      let labels = 0; // side by side, since levels lie near one another
      for (const { value, label, colour = "threshold", dash = [6, 4] } of levels) {
        const y = u.valToPos(canine.toShown(value, unit), "y", true);
        if (y < top || y > top + height) continue;
        context.strokeStyle = context.fillStyle = canine.colour(colour);
        context.lineWidth = devicePixelRatio;
        context.setLineDash(dash.map((part) => part * devicePixelRatio));
        context.beginPath();
        context.moveTo(left, y);
        context.lineTo(left + width, y);
        context.stroke();
        if (label) canine.write(context, label, left + width - (4 + 90 * labels++) * devicePixelRatio, y - 3 * devicePixelRatio);
      }
      context.restore();
    }

    // A panel: {title, unit, height, levels: [{value, label}], range: [least, most], turn, series: [{label,
    // colour, width, dash, points, step, around}]}; then set(time, [values...]) with values in SI. `around`
    // has the standard deviations of the values: 2 sigma are shaded. `turn` is a whole turn of angles.
    function add(panel) {
      const { title, unit = "", height = 130, turn = 0, series } = panel;
      let range = panel.range || null;
      const name = canine.shownUnit(unit);
      const head = canine.element("div", { class: "plot-head" },
        canine.element("h3", {}, title + (name ? ` [${name}]` : "")));
      const readings = series.map((one) => {
        const swatch = canine.element("span", { class: "swatch", "aria-hidden": "true" });
        swatch.style.background = `var(--${one.colour})`;
        const [on, off] = one.dash || [];
        if (on) swatch.style.maskImage = `repeating-linear-gradient(90deg, #000 0 ${on}px, #0000 0 ${on + off}px)`;
        const value = canine.element("span", { class: "number" }, "");
        head.append(canine.element("span", { class: "reading" }, swatch, one.label + " ", value));
        return value;
      });
      const body = canine.element("div", { role: "img", "aria-label": title + " over time" });
      const cursor = canine.element("div", { class: "time-cursor" });
      element.append(canine.element("div", { class: "plot" }, head, body));

      const drawn = [{}], fills = [], places = [];
      for (const one of series) {
        places.push(drawn.length);
        const colour = () => canine.colour(one.colour);
        drawn.push({
          stroke: colour, width: one.points ? 0 : one.width || 1.6, dash: one.dash, spanGaps: false,
          points: one.points ? { show: true, size: 4, width: 0, fill: colour } : { show: false },
          paths: one.step ? uPlot.paths.stepped({ align: 1 }) : one.points ? () => null : undefined,
        });
        if (one.around) {
          fills.push({ series: [drawn.length, drawn.length + 1], fill: () => canine.colour("sigma") });
          const bare = { width: 0, stroke: "transparent", points: { show: false } };
          drawn.push(bare, { ...bare });
        }
      }
      const axis = { stroke: () => canine.colour("soft"), grid: { stroke: () => canine.colour("grid"), width: 1 },
        ticks: { stroke: () => canine.colour("grid"), width: 1, size: 4 }, font: "11px system-ui, sans-serif" };
      const u = new uPlot({
        width: Math.max(element.clientWidth, 100), height, legend: { show: false }, pxAlign: 1,
        padding: [6, RIGHT, 0, 0], series: drawn, bands: fills,
        scales: { x: { time: false, auto: false, range: () => timeline.shown.slice() },
          y: { range: (self, least, most) => spread(least, most, range, panel.include) } },
        axes: [{ ...axis, size: 22, gap: 2, incrs: STEPS, values: times }, { ...axis, size: AXIS * rem, gap: 4, space: 16, splits: panel.splits && (() => panel.splits) }],
        cursor: { x: false, y: false, points: { show: false }, drag: { x: true, y: false, setScale: false },
          bind: { dblclick: () => () => timeline.zoom(Infinity) } },
        hooks: {
          drawClear: [drawBehind],
          draw: [(self) => drawLevels(self, panel.levels || [], unit)],
          setCursor: [(self) => {
            if (self.cursor.event && self.cursor.left >= 0 && !timeline.playing) timeline.move(self.posToVal(self.cursor.left, "x"));
          }],
          setSelect: [(self) => {
            const { left, width } = self.select;
            if (width > 4) timeline.show(self.posToVal(left, "x"), self.posToVal(left + width, "x"));
            self.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
          }],
        },
      }, [[], ...drawn.slice(1).map(() => [])], body);
      u.over.append(cursor);
      u.over.addEventListener("wheel", (event) => {
        if (!event.ctrlKey && !event.shiftKey) return; // a plain wheel scrolls the page
        event.preventDefault();
        timeline.zoom((event.deltaY || event.deltaX) > 0 ? 1.25 : 0.8);
      }, { passive: false });

      const own = { u, cursor, time: [], values: [] };
      // Values at the cursor: of the row before it; of points, of the last one before it.
      own.read = function (time) {
        const at = canine.rowAt(own.time, time);
        readings.forEach((reading, i) => {
          let row = at;
          while (series[i].points && row > 0 && !canine.isNumber(own.values[i][row])) row--;
          const value = row < 0 ? null : own.values[i][row];
          const sd = series[i].around && row >= 0 ? series[i].around[row] : null;
          reading.textContent = canine.format(value, unit) + (canine.isNumber(sd) ? " \u00b1 " + canine.format(2 * sd, unit) : "");
        });
      };
      own.place = function () {
        const [first, last] = timeline.shown;
        cursor.style.left = (100 * (timeline.time - first)) / (last - first || 1) + "%";
        own.read(timeline.time);
      };
      panels.push(own);
      return {
        u,
        // New values, (rows,) each, in SI and in the order of `series`; `around` replaces the standard deviations.
        set(time, values, around) {
          own.time = time;
          own.values = values;
          const columns = [time];
          values.forEach((column, i) => {
            if (around && around[i]) series[i].around = around[i];
            const shown = shownValues(column, unit);
            columns.push(turn ? unwrapped(shown, canine.toShown(turn, unit)) : shown);
            if (series[i].around) {
              const sd = shownValues(series[i].around, unit), sides = panel.aroundZero ? column.map(() => 0) : shown;
              const side = (sign) => sides.map((value, row) => (value === null || sd[row] === null ? null : value + sign * 2 * sd[row]));
              columns.push(side(1), side(-1));
            }
          });
          u.setData(columns);
          own.place();
        },
        // What the axis shows, in the shown unit; null for what there is.
        setRange(next) {
          range = next || null;
        },
        // Shows or hides the lines of a name.
        show(label, isShown) {
          series.forEach((one, i) => {
            if (one.label !== label) return;
            readings[i].parentElement.hidden = !isShown;
            u.setSeries(places[i], { show: isShown });
            if (one.around) [1, 2].forEach((side) => u.setSeries(places[i] + side, { show: isShown }));
          });
        },
      };
    }

    let shown = timeline.shown;
    timeline.listen(() => {
      if (shown[0] !== timeline.shown[0] || shown[1] !== timeline.shown[1]) {
        shown = timeline.shown;
        for (const { u } of panels) u.setScale("x", { min: shown[0], max: shown[1] });
      }
      for (const panel of panels) panel.place();
    });
    canine.onRestyle(() => panels.forEach(({ u }) => u.redraw(false, true)));
    new ResizeObserver(() => {
      const width = element.clientWidth;
      for (const { u } of panels) if (width && width !== u.width) u.setSize({ width, height: u.height });
    }).observe(element);
    return {
      add,
      // [{from, until, kind, text}]: kind is outage, order, lost or fault.
      setBands(next) {
        bands = next;
        panels.forEach(({ u }) => u.redraw(false, true));
      },
      // [{time, kind, text}]: kind is waypoint or anomaly.
      setMarks(next) {
        marks = next;
        panels.forEach(({ u }) => u.redraw(false, true));
      },
    };
  };

  function spread(least, most, range, include) {
    if (range) return range;
    const all = [least, most, ...(include || [])].filter(canine.isNumber);
    const low = all.length ? Math.min(...all) : 0, high = all.length ? Math.max(...all) : 1;
    const room = (high - low) * 0.06 || Math.max(Math.abs(high) * 0.1, 0.5);
    return [low === 0 ? 0 : low - room, high + room];
  }
})();
