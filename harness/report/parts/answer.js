// A page from its data: map, strip and panels with one cursor, events, keys. README.md describes the data.
(function () {
  "use strict";
  const of = (id) => document.getElementById(id);
  const data = JSON.parse(of("data").textContent), { time, signals } = data;
  const timeline = canine.timeline(time[0], time[time.length - 1]);
  const place = ([north, east], row) => [signals[north][row], signals[east][row]];
  const places = (names) => time.map((_, row) => place(names, row));
  const commands = (signal) => signals[signal].map((code) => (code === null ? null : canine.COMMANDS[code] || "NONE"));
  const words = { outage: "GPS outage", order: "operator's order", lost: "lost radio", fault: "fault" };

  // The map: what disturbed the trial lies under the path, the mission under both.
  const map = data.tracks.length ? canine.map(of("map"), { origin: data.origin, label: "map of the trial" }) : null;
  const animals = [], legend = of("legend");
  const explain = (className, colour, text) => {
    const sign = canine.element("span", { class: className, "aria-hidden": "true" });
    sign.style.background = `var(--${colour})`;
    legend.append(canine.element("span", {}, sign, text));
  };
  if (map) {
    const main = data.tracks[data.tracks.length - 1], path = places(main.place);
    if (data.route) map.mission(data.route);
    for (const kind of Object.keys(words)) {
      const lines = data.bands.filter((band) => band.kind === kind)
        .map(({ from, until }) => path.slice(canine.rowAt(time, from), canine.rowAt(time, until) + 1));
      if (lines.length) map.trails(kind, lines);
    }
    for (const track of data.tracks) {
      const points = places(track.place);
      if (track.class === "fix") map.dots("fix", points);
      else {
        map.track(track.class).set(points, track.command ? commands(track.command) : undefined);
        animals.push([map.animal(track.class), track]);
      }
      if (!track.command) explain("line", track.colour, track.label);
    }
    if (main.command) canine.COMMANDS.filter((name) => commands(main.command).includes(name))
      .forEach((name) => explain("line", name.toLowerCase(), name === "NONE" ? "no command" : name.toLowerCase()));
    for (const { time: at, kind, text } of data.marks) {
      if (kind === "anomaly") map.mark(path[Math.max(canine.rowAt(time, at), 0)], "\u26a0", text);
    }
    map.fit();
  } else of("map").remove();
  for (const kind of Object.keys(words)) {
    if (data.bands.some((band) => band.kind === kind)) explain("band", kind, words[kind]);
  }
  if (data.marks.some(({ kind }) => kind === "anomaly")) legend.append(canine.element("span", {}, "\u26a0 anomaly"));

  // What the animal is told, and what it feels.
  const blocks = function ({ signal, kind, text: side }) {
    const made = canine.stretches(signals[signal]).map(({ first, last, value }) => ({ from: time[first], until: time[last], value }));
    if (kind === "command") return canine.commandBlocks(time, commands(signal));
    return made.filter(({ value }) => value).map((block) => {
      const text = kind === "order" ? canine.COMMANDS[block.value] : kind === "tone" ? canine.format(block.value, "Hz") : side;
      return { ...block, className: kind, text, title: `${text} from ${canine.clock(block.from)} to ${canine.clock(block.until)}` };
    });
  };
  const strips = {};
  for (const row of data.strips) {
    strips[row.name] = [...(strips[row.name] || []), ...blocks(row)].sort((one, other) => one.from - other.from);
  }
  canine.strip(of("strip"), timeline).set(strips);
  const told = data.strips.find((row) => row.kind === "command"), cue = canine.cue();
  const names = told ? commands(told.signal) : [], [tone, left, right] = data.felt || [];
  if (data.felt && told) of("cue").append(cue.element);

  const plots = canine.plots(of("plots"), timeline);
  for (const panel of data.panels) {
    const series = panel.series.map((line) => ({ ...line, around: line.around && signals[line.around] }));
    plots.add({ ...panel, series }).set(time, panel.series.map(({ signal }) => signals[signal]));
  }
  plots.setBands(data.bands);
  plots.setMarks(data.marks);

  const rows = [...document.querySelectorAll("#events tbody tr")];
  rows.forEach((row, i) => row.querySelector("button").addEventListener("click", () => timeline.move(data.events[i])));
  let now = null;
  timeline.listen(() => {
    const row = Math.max(canine.rowAt(time, timeline.time), 0);
    for (const [animal, { place: names, heading, sd }] of animals) {
      animal.place(place(names, row), heading && signals[heading][row], sd && place(sd, row));
    }
    if (told) {
      const felt = (signal) => (signal ? signals[signal][row] : 0);
      const known = tone || left || right; // where the log has a command module
      cue.set(names[row], known ? { tone_hz: felt(tone), vibrate_left: felt(left), vibrate_right: felt(right) } : null);
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
    m: () => map && map.fit(), t: () => canine.setTheme(canine.isDark() ? "light" : "dark"),
  };
  document.addEventListener("keydown", (event) => {
    const key = event.key.length > 1 ? event.key : event.key.toLowerCase(), busy = event.target.closest(" button, select, input, summary, .map");
    if (!keys[key] || event.ctrlKey || event.metaKey || event.altKey || (busy && (key.length > 1 || key === " "))) return;
    event.preventDefault();
    keys[key](event);
  });
})();
