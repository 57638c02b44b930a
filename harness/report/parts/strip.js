// Commands over time as a strip, and each as the dog feels it: tone and vibration (Table 4.1).
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const LEAST = 0.0008; // share of the width below which blocks are drawn as one
  const LETTER = 7.5; // px

  // What a dog feels, in words, of an outcome of the command module.
  canine.cueWords = function ({ tone_hz: tone, vibrate_left: left, vibrate_right: right }) {
    const cues = [];
    if (tone) cues.push("tone of " + canine.format(tone, "Hz"));
    if (left) cues.push("vibration at the back left (ribs)");
    if (right) cues.push("vibration at the front right (shoulder)");
    return cues.join(", ") || "nothing";
  };
  // The command in force as a large sign with its cue; `set(command, {tone_hz, vibrate_left, vibrate_right})`.
  canine.cue = function () {
    const glyph = canine.element("span", { class: "glyph NONE", "aria-hidden": "true" });
    const name = canine.element("strong", {}), words = canine.element("span", { class: "soft" });
    return {
      element: canine.element("div", { class: "cue" }, glyph, canine.element("div", {}, name, canine.element("br", {}), words)),
      set(command, felt) {
        glyph.className = "glyph " + command;
        glyph.textContent = canine.GLYPHS[command] || "?";
        name.textContent = command === "NONE" ? "no command" : command;
        words.textContent = felt ? "the dog feels: " + canine.cueWords(felt) : "";
      },
    };
  };

  // Rows of blocks over time. `set({row: [{from, until, text, className, title}]})` in the order to be drawn.
  canine.strip = function (element, timeline) {
    element.classList.add("strip");
    const cursor = canine.element("div", { class: "time-cursor" });
    let rows = {}, shown = null;
    const draw = function () {
      const [first, last] = timeline.shown, width = last - first || 1;
      element.replaceChildren(cursor);
      for (const [name, blocks] of Object.entries(rows)) {
        const row = canine.element("div", { class: "strip-row" });
        let end = -1;
        for (const block of blocks) {
          const from = Math.max((block.from - first) / width, 0), until = Math.min((block.until - first) / width, 1);
          if (until <= from || until - end < LEAST) continue;
          end = until;
          const letters = ((until - from) * element.clientWidth) / LETTER; // that it has room for
          const text = block.text.length < letters ? block.text : letters > 2 ? block.glyph || "" : "";
          const drawn = canine.element("div", { class: "strip-block " + block.className, title: block.title }, text);
          drawn.style.left = 100 * from + "%";
          drawn.style.width = 100 * (until - from) + "%";
          row.append(drawn);
        }
        element.append(canine.element("div", { class: "strip-name" }, name), row);
      }
    };
    timeline.listen(() => {
      const [first, last] = timeline.shown;
      if (!shown || shown[0] !== first || shown[1] !== last) {
        shown = [first, last];
        draw();
      }
      cursor.style.left = (100 * (timeline.time - first)) / (last - first || 1) + "%";
    });
    new ResizeObserver(draw).observe(element);
    return {
      set(next) {
        rows = next;
        draw();
      },
    };
  };
  // The blocks of commands, (rows,) each: names of `canine.COMMANDS`.
  canine.commandBlocks = (times, commands) =>
    canine.stretches(commands).filter(({ value }) => value).map(({ first, last, value }) => ({
      from: times[first], until: times[last], text: value.toLowerCase(), glyph: canine.GLYPHS[value], className: value,
      title: `${value} from ${canine.clock(times[first])} to ${canine.clock(times[last])}`,
    }));
})();
