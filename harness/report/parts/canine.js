// What all parts share: names, numbers in the units that users read, elements, colours, and time.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});

  canine.COMMANDS = ["NONE", "FORWARD", "STOP", "RECALL", "LEFT", "RIGHT"];
  canine.GLYPHS = { NONE: "\u00b7", FORWARD: "\u2191", STOP: "\u25a0", RECALL: "\u21a9", LEFT: "\u2190", RIGHT: "\u2192" };
  const NO_VALUE = "\u2013";
  const DEGREES = 180 / Math.PI;

  // The unit that users read for a unit of the log: factor, name, decimals.
  const SHOWN = {
    rad: [DEGREES, "deg", 1], "rad/s": [DEGREES, "deg/s", 1], m: [1, "m", 2], "m/s": [1, "m/s", 2],
    "m/s2": [1, "m/s2", 2], s: [1, "s", 2], Hz: [1, "Hz", 0], "1": [1, "", null], "": [1, "", null],
  };

  canine.isNumber = (value) => typeof value === "number" && Number.isFinite(value);
  canine.shownUnit = (unit) => (SHOWN[unit] || [1, unit])[1];
  canine.toShown = (value, unit) => (canine.isNumber(value) ? value * (SHOWN[unit] || [1])[0] : null);
  // A value in SI as text in the unit that users read; a dash for none.
  canine.format = function (value, unit, decimals) {
    if (!canine.isNumber(value)) return NO_VALUE;
    const [factor, name, usual] = SHOWN[unit] || [1, unit || "", 3];
    const places = decimals === undefined ? usual : decimals;
    const text = places === null ? String(Number((value * factor).toPrecision(4))) : (value * factor).toFixed(places);
    return (Number(text) === 0 ? text.replace("-", "") : text) + (name ? " " + name : "");
  };
  // A time [s] as minutes and seconds, 3:07.50; from an hour on 1:02:03.90. `clock` of times.py writes the same.
  canine.clock = function (seconds, decimals = 2) {
    if (!canine.isNumber(seconds)) return NO_VALUE;
    const unit = 10 ** decimals, count = Math.floor(seconds * unit + 0.5), minutes = Math.floor(count / unit / 60);
    const two = (value, places) => value.toFixed(places).padStart(places ? 3 + places : 2, "0");
    const hours = minutes < 60 ? minutes : Math.floor(minutes / 60) + ":" + two(minutes % 60, 0);
    return hours + ":" + two(count / unit - 60 * minutes, decimals);
  };

  // The last row at or before a time, of times that grow; -1 before the first.
  canine.rowAt = function (times, time) {
    let low = 0, high = times.length;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (times[middle] <= time) low = middle + 1;
      else high = middle;
    }
    return low - 1;
  };
  // Stretches of equal values as {first, last, value}; last is the row after, or the last row.
  canine.stretches = function (values) {
    const found = [];
    for (let row = 0; row < values.length; row++) {
      if (!row || values[row] !== values[row - 1]) {
        if (row) found[found.length - 1].last = row;
        found.push({ first: row, last: values.length - 1, value: values[row] });
      }
    }
    return found;
  };

  // An element with attributes (class, title, ...) and children: elements, or text, which stays text.
  canine.element = function (tag, attributes, ...children) {
    const element = document.createElement(tag);
    for (const [name, value] of Object.entries(attributes || {})) {
      if (value !== null && value !== undefined && value !== false) element.setAttribute(name, value === true ? "" : value);
    }
    element.append(...children.map((child) => (child instanceof Node ? child : String(child))));
    return element;
  };

  // A colour of style.css as the browser resolves it, for what is drawn on a canvas: canine.colour("truth").
  let colours = new Map();
  canine.colour = function (name) {
    if (!colours.has(name)) {
      const probe = canine.element("span", {});
      probe.style.color = `var(--${name})`;
      document.body.append(probe);
      colours.set(name, getComputedStyle(probe).color);
      probe.remove();
    }
    return colours.get(name);
  };
  const restyled = new Set();
  // Calls back whenever the colours have changed: the switch, the system's setting, or printing.
  canine.onRestyle = (react) => restyled.add(react);
  const restyle = function () {
    colours = new Map();
    for (const react of restyled) react();
  };
  const root = document.documentElement;
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  dark.addEventListener("change", restyle);
  canine.isDark = () => (root.dataset.theme ? root.dataset.theme === "dark" : dark.matches);
  canine.setTheme = function (theme) {
    if (theme) root.dataset.theme = theme;
    else delete root.dataset.theme;
    restyle();
  };
  canine.turnTheme = () => canine.setTheme(canine.isDark() ? "light" : "dark");
  let beforePrint;
  window.addEventListener("beforeprint", () => {
    beforePrint = root.dataset.theme;
    canine.setTheme("light");
  });
  window.addEventListener("afterprint", () => canine.setTheme(beforePrint));
  // A button that switches between dark and light.
  canine.themeSwitch = function () {
    const button = canine.element("button", { type: "button", class: "no-print" }, "");
    const label = () => (button.textContent = canine.isDark() ? "Light" : "Dark");
    button.addEventListener("click", canine.turnTheme);
    canine.onRestyle(label);
    label();
    return button;
  };

  // Time as all views share it: the cursor `time`, all of it `from` to `until`, and the stretch that is `shown`.
  canine.timeline = function (from, until) {
    const listeners = new Set();
    let frame = null, before = null;
    const timeline = {
      from, until, time: from, shown: [from, until], speed: 1,
      get playing() { return frame !== null; },
      // Calls back on every change, and once now; gives the function that ends it.
      listen(react) {
        listeners.add(react);
        react(timeline);
        return () => listeners.delete(react);
      },
      move(time) {
        timeline.time = Math.min(Math.max(time, timeline.from), timeline.until);
        const [first, last] = timeline.shown;
        if (timeline.time < first || timeline.time > last) {
          const start = timeline.time < first ? timeline.time : timeline.time - (last - first) * 0.1;
          return timeline.show(start, start + (last - first));
        }
        return tell();
      },
      show(first, last) {
        const whole = timeline.until - timeline.from;
        const width = Math.min(Math.max(last - first, Math.min(0.2, whole)), whole);
        const start = Math.min(Math.max(first, timeline.from), timeline.until - width);
        timeline.shown = [start, start + width];
        tell();
      },
      // Zooms about the cursor: 0.5 shows half as much, Infinity shows all.
      zoom(factor) {
        const [first, last] = timeline.shown;
        if (!Number.isFinite(factor)) return timeline.show(timeline.from, timeline.until);
        const left = (timeline.time - first) * factor, right = (last - timeline.time) * factor;
        return timeline.show(timeline.time - left, timeline.time + right);
      },
      // Time goes on, as while a trial runs: the cursor and the view stay at the end if they were there.
      extend(end) {
        const [first, last] = timeline.shown;
        const follows = timeline.time >= timeline.until, all = first <= timeline.from && last >= timeline.until;
        const shift = last >= timeline.until ? end - timeline.until : 0;
        timeline.until = end;
        timeline.shown = all ? [timeline.from, end] : [first + shift, last + shift];
        if (follows) timeline.time = end;
        tell();
      },
      play(speed) {
        timeline.speed = speed || timeline.speed;
        if (timeline.time >= timeline.until) timeline.move(timeline.from);
        if (frame === null) {
          before = null;
          frame = requestAnimationFrame(step);
        }
        tell();
      },
      pause() {
        if (frame !== null) cancelAnimationFrame(frame);
        frame = null;
        tell();
      },
    };
    const tell = () => listeners.forEach((react) => react(timeline));
    const step = function (now) {
      frame = requestAnimationFrame(step);
      if (before !== null) timeline.move(timeline.time + ((now - before) / 1000) * timeline.speed);
      before = now;
      if (timeline.time >= timeline.until) timeline.pause();
    };
    return timeline;
  };

  // Play and pause, speed, a slider and the time. `move`, `play` and `pause` of another timeline will do as well.
  canine.playback = function (timeline, speeds) {
    const button = canine.element("button", { type: "button" }, "Play");
    const speed = canine.element("select", { "aria-label": "speed of playback" });
    for (const value of speeds || [0.5, 1, 2, 5, 10, 50]) speed.append(canine.element("option", { value }, value + "\u00d7"));
    speed.value = "1";
    const slider = canine.element("input", { type: "range", step: "any", "aria-label": "time" });
    const shown = canine.element("output", {});
    button.addEventListener("click", () => (timeline.playing ? timeline.pause() : timeline.play(Number(speed.value))));
    speed.addEventListener("change", () => {
      timeline.speed = Number(speed.value);
      if (timeline.playing) timeline.play(timeline.speed);
    });
    slider.addEventListener("input", () => timeline.move(Number(slider.value)));
    timeline.listen(() => {
      button.textContent = timeline.playing ? "Pause" : "Play";
      slider.min = timeline.from;
      slider.max = timeline.until;
      slider.value = timeline.time;
      slider.setAttribute("aria-valuetext", canine.clock(timeline.time));
      shown.textContent = canine.clock(timeline.time) + " of " + canine.clock(timeline.until);
    });
    return canine.element("div", { class: "playback no-print" }, button, speed, slider, shown);
  };
})();
