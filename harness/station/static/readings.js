// What the vest tells, in numbers: the large ones beside the map, and the rest of the telemetry.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const RANGE = Math.PI / 2; // rad that the gauge shows to each side
  const WIDE = 9; // characters that a column holds in large
  const UNLIMITED = 65535, NOT_TOLD = -32768; // of the telemetry's whole numbers

  // A list of terms and values whose elements are kept: `set({term: text})`, or `[text, level]`.
  canine.numbers = function (list) {
    const values = new Map();
    return {
      set(texts) {
        for (const [term, text] of Object.entries(texts)) {
          if (!values.has(term)) {
            const value = canine.element("dd", { class: "number" }, "");
            list.append(canine.element("div", {}, canine.element("dt", {}, term), value));
            values.set(term, value);
          }
          const value = values.get(term), [words, level] = Array.isArray(text) ? text : [text, ""];
          if (value.textContent !== words) value.textContent = words;
          const className = `number ${level || ""}${words.length > WIDE ? " wide" : ""}`;
          if (value.className !== className) value.className = className;
        }
      },
    };
  };

  // The deviation as a needle over its thresholds, right is right.
  canine.gauge = function (element) {
    const needle = canine.element("span", { class: "needle" }), zone = canine.element("span", { class: "zone" });
    const inner = canine.element("span", { class: "zone inner" }), words = canine.element("span", { class: "words number" }, "");
    zone.hidden = inner.hidden = needle.hidden = true; // until they are known
    element.append(zone, inner, canine.element("span", { class: "middle" }), needle, words);
    let moving = null; // the deviation at which a turn begins
    const percent = (angle) => 50 + (50 * Math.max(-RANGE, Math.min(RANGE, angle))) / RANGE + "%";
    return {
      setThresholds(thresholds) {
        moving = thresholds.moving_deviation;
        for (const [part, angle] of [[zone, moving], [inner, thresholds.stop_deviation]]) {
          part.hidden = !canine.isNumber(angle);
          part.style.left = percent(-angle || 0);
          part.style.right = `calc(100% - ${percent(angle || 0)})`;
        }
      },
      set(deviation) {
        const known = canine.isNumber(deviation);
        needle.hidden = !known;
        if (known) needle.style.left = percent(deviation);
        element.classList.toggle("beyond", known && canine.isNumber(moving) && Math.abs(deviation) > moving);
        const side = deviation < 0 ? "left" : "right";
        words.textContent = known ? `${canine.format(Math.abs(deviation), "rad", 0)} ${side}` : "no deviation";
        element.setAttribute("aria-label", "deviation from the target: " + words.textContent);
      },
    };
  };

  // Ages of counters: the time since one last changed, in the station's time.
  canine.ages = function () {
    const held = new Map();
    return function (name, count, now) {
      const before = held.get(name);
      if (!before || before[0] !== count || now < before[1]) held.set(name, [count, now]);
      return now - held.get(name)[1];
    };
  };
  const left = (value, limit, show) => (value === undefined ? "\u2013" : value >= limit ? "no limit" : show(value));
  canine.leftOf = {
    issues: (value) => left(value, UNLIMITED, (turns) => `${turns} more`),
    seconds: (value) => left(value, UNLIMITED / 10 - 0.01, (seconds) => canine.format(seconds, "s", 1)),
  };
  // Where the animal looks: whole degrees from north, 0 to 359.
  canine.compass = (heading) =>
    canine.isNumber(heading) ? `${(Math.round(canine.toShown(heading, "rad")) + 360) % 360} deg` : "\u2013";
  // The limit of turns, and for what it holds.
  canine.mostTurns = ({ max_turns: most, reset_turns: isForEach }) =>
    canine.isNumber(most) ? `${most} ${isForEach ? "on each leg" : "in a trial"}` : "\u2013";
  canine.battery = (volts) => (volts ? canine.format(volts, "V", 2) : "not told");
  canine.temperature = (degrees) =>
    degrees === undefined || degrees <= NOT_TOLD / 10 ? "not told" : degrees.toFixed(1) + " \u00b0C";
})();
