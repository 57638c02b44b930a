// A page from its data: map, strip and panels with one cursor, events, keys. README.md describes the data.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const NEAR = 12; // px from the path
  const WORDS = { outage: "GPS outage", order: "operator's order", lost: "lost radio", fault: "fault" };
  const of = (id) => document.getElementById(id);

  // Draws data; gives `update(next)`, which takes the rows from `next.from` on, as while a trial goes on.
  canine.answer = function (data) {
    const time = data.time, signals = data.signals, timeline = canine.timeline(time[0], time[time.length - 1]);
    const place = ([north, east], row) => [signals[north][row], signals[east][row]];
    const places = (names) => time.map((_, row) => place(names, row));
    const commands = (signal) => signals[signal].map((code) => (code === null ? null : canine.COMMANDS[code] || "NONE"));

    // The map: what disturbed the trial lies under the path, the mission under both.
    const map = data.tracks.length ? canine.map(of("map"), { label: "map of the trial" }) : null;
    const main = data.tracks[data.tracks.length - 1];
    const drawn = data.tracks.map((track) => ({ track, dots: null, line: null, animal: null, entry: null }));
    let path = [], passing = []; // the animal's places; layers that are drawn anew with each update
    if (map) {
      if (data.route) map.mission(data.route);
      for (const one of drawn) {
        const { track } = one;
        if (track.class === "fix") continue;
        one.line = map.track(track.class);
        one.animal = map.animal(track.class);
      }
      // A place of the path that is pointed at moves the time cursor there.
      map.leaflet.on("mousemove", ({ latlng, containerPoint }) => {
        if (timeline.playing) return;
        let best = Math.abs(map.leaflet.containerPointToLatLng([containerPoint.x + NEAR, containerPoint.y]).lng - latlng.lng), row = -1;
        path.forEach(([north, east], i) => {
          if (!canine.isNumber(north) || !canine.isNumber(east)) return;
          const off = Math.hypot(north - latlng.lat, east - latlng.lng);
          if (off < best) [best, row] = [off, i];
        });
        if (row >= 0) timeline.move(time[row]);
      });
    } else of("map").remove();

    const explained = (className, colour, text, tag) => {
      const sign = canine.element("span", { class: className, "aria-hidden": "true" });
      sign.style.background = `var(--${colour})`;
      return canine.element(tag || "span", tag ? { type: "button", class: "choice" } : {}, sign, text);
    };
    for (const one of drawn) {
      if (one.track.optional) one.entry = explained("line " + one.track.class, one.track.colour, one.track.label, "button");
    }
    function explain() {
      const entries = drawn.filter(({ track }) => !track.command)
        .map(({ track, entry }) => entry || explained("line", track.colour, track.label));
      if (main && main.command) {
        const given = new Set(commands(main.command));
        entries.push(...canine.COMMANDS.filter((name) => given.has(name))
          .map((name) => explained("line", name.toLowerCase(), name === "NONE" ? "no command" : name.toLowerCase())));
      }
      entries.push(...Object.keys(WORDS).filter((kind) => data.bands.some((band) => band.kind === kind))
        .map((kind) => explained("band", kind, WORDS[kind])));
      const { streets = [], poles = [] } = data.route || {};
      if (streets.length) entries.push(explained("band", "line", "street"));
      if (poles.length) entries.push(canine.element("span", {}, "\u25b2 pole"));
      if (data.marks.some(({ kind }) => kind === "anomaly")) entries.push(canine.element("span", {}, "\u26a0 anomaly"));
      of("legend").replaceChildren(...entries);
    }
    function drawMap() {
      path = places(main.place);
      passing.forEach((layer) => layer.remove());
      passing = [];
      for (const kind of Object.keys(WORDS)) {
        const lines = data.bands.filter((band) => band.kind === kind)
          .map(({ from, until }) => path.slice(canine.rowAt(time, from), canine.rowAt(time, until) + 1));
        if (lines.length) passing.push(map.trails(kind, lines));
      }
      for (const { track, line } of drawn) {
        const points = track === main ? path : places(track.place);
        if (line) line.set(points, track.command ? commands(track.command) : undefined);
        else passing.push(map.dots("fix", points));
      }
      for (const { time: at, kind, text } of data.marks) {
        const mark = kind === "anomaly" && map.mark(path[Math.max(canine.rowAt(time, at), 0)], "\u26a0", text);
        if (mark) passing.push(mark);
      }
    }

    // What the animal is told, and what it feels.
    const blocks = function ({ signal, kind, text: side }) {
      const made = canine.stretches(signals[signal]).map(({ first, last, value }) => ({ from: time[first], until: time[last], value }));
      if (kind === "command") return canine.commandBlocks(time, commands(signal));
      return made.filter(({ value }) => value).map((block) => {
        const text = kind === "order" ? canine.COMMANDS[block.value] : kind === "tone" ? canine.format(block.value, "Hz") : side;
        return { ...block, className: kind, text, title: `${text} from ${canine.clock(block.from)} to ${canine.clock(block.until)}` };
      });
    };
    const strip = canine.strip(of("strip"), timeline), cue = canine.cue();
    const told = data.strips.find((row) => row.kind === "command"), [tone, left, right] = data.felt || [];
    if (data.felt && told) of("cue").append(cue.element);
    function drawStrip() {
      const strips = {};
      for (const row of data.strips) {
        strips[row.name] = [...(strips[row.name] || []), ...blocks(row)].sort((one, other) => one.from - other.from);
      }
      strip.set(strips);
    }

    const plots = canine.plots(of("plots"), timeline);
    const around = (panel) => panel.series.map((line) => line.around && signals[line.around]);
    const panels = data.panels.map((panel) => {
      const deviations = around(panel);
      return plots.add({ ...panel, series: panel.series.map((line, i) => ({ ...line, around: deviations[i] })) });
    });

    let rows = [], now = null;
    function list() {
      rows = [...document.querySelectorAll("#events tbody tr")];
      rows.forEach((row, i) => row.querySelector("button").addEventListener("click", () => timeline.move(data.events[i])));
    }
    function draw() {
      if (map) drawMap();
      explain();
      drawStrip();
      data.panels.forEach((panel, i) => {
        panels[i].setRange(panel.range);
        panels[i].set(time, panel.series.map(({ signal }) => signals[signal]), around(panel));
      });
      plots.setBands(data.bands);
      plots.setMarks(data.marks);
    }
    draw();
    list();
    if (map) map.fit();

    // Tracks that can be hidden, with their lines in the panels.
    for (const { track, line, animal, entry } of drawn) {
      if (!entry) continue;
      const show = function (isShown) {
        track.shown = isShown;
        entry.setAttribute("aria-pressed", String(isShown));
        if (isShown) line.layer.addTo(map.content);
        else {
          map.content.removeLayer(line.layer);
          animal.place(null);
        }
        for (const panel of panels) panel.show(track.label, isShown);
      };
      entry.addEventListener("click", () => {
        show(!track.shown);
        timeline.move(timeline.time);
      });
      show(track.shown);
    }

    timeline.listen(() => {
      const row = Math.max(canine.rowAt(time, timeline.time), 0);
      for (const { animal, track: { place: names, heading, sd, optional, shown } } of drawn) {
        if (!animal || (optional && !shown)) continue;
        animal.place(place(names, row), heading && signals[heading][row], sd && place(sd, row));
      }
      if (told) {
        const felt = (signal) => (signal ? signals[signal][row] : 0), code = signals[told.signal][row];
        const known = tone || left || right; // where the log has a command module
        cue.set(code === null ? null : canine.COMMANDS[code] || "NONE",
          known ? { tone_hz: felt(tone), vibrate_left: felt(left), vibrate_right: felt(right) } : null);
      }
      const last = rows[canine.rowAt(data.events || [], timeline.time)];
      if (last !== now) {
        if (now) now.classList.remove("now");
        if (last) last.classList.add("now");
        now = last;
      }
    });

    const fit = canine.element("button", { type: "button" }, "All of the map");
    const all = canine.element("button", { type: "button" }, "All of the time");
    fit.addEventListener("click", () => map && map.fit());
    all.addEventListener("click", () => timeline.zoom(Infinity));
    of("tools").append(...(map ? [fit] : []), all, canine.themeSwitch());
    of("playback").append(canine.playback(timeline));
    const step = (event, sign) => {
      const row = canine.rowAt(time, timeline.time);
      timeline.move(event.shiftKey ? timeline.time + sign : time[Math.min(Math.max(row + sign, 0), time.length - 1)]);
    };
    const keys = {
      " ": () => (timeline.playing ? timeline.pause() : timeline.play()),
      ArrowLeft: (event) => step(event, -1), ArrowRight: (event) => step(event, 1),
      Home: () => timeline.move(timeline.from), End: () => timeline.move(timeline.until),
      "+": () => timeline.zoom(0.5), "=": () => timeline.zoom(0.5), "-": () => timeline.zoom(2), 0: () => timeline.zoom(Infinity),
      m: () => map && map.fit(), t: canine.turnTheme,
    };
    document.addEventListener("keydown", (event) => {
      const key = event.key.length > 1 ? event.key : event.key.toLowerCase(), busy = event.target.closest(" button, select, input, summary, .map");
      if (!keys[key] || event.ctrlKey || event.metaKey || event.altKey || (busy && (key.length > 1 || key === " "))) return;
      event.preventDefault();
      keys[key](event);
    });

    return {
      timeline,
      // The rows from `next.from` on, and what all of them amount to.
      update(next) {
        const { from, time: times, signals: columns, ...whole } = next;
        Object.assign(data, whole);
        time.splice(from, Infinity, ...times);
        for (const [name, values] of Object.entries(columns)) {
          signals[name] = signals[name] || [];
          signals[name].splice(from, Infinity, ...values);
        }
        draw();
        list();
        const last = path.at(-1);
        if (map && last && last.every(canine.isNumber) && !map.leaflet.getBounds().contains(last)) map.fit();
        timeline.extend(time[time.length - 1]);
      },
    };
  };

  const data = JSON.parse(of("data").textContent);
  if (data) canine.answer(data);
})();
