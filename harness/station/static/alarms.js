// Alarms by AC 25.1322: red warnings that need action at once, amber cautions; with the reason, and a sound.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const WARNING = { pitch: [880, 660, 880], every: 2000 }; // Hz, ms between two calls
  const CAUTION = { pitch: [520, 520], every: null }; // once
  const NOTE_S = 0.16;

  canine.sound = function () {
    let context = null, muted = false;
    // A browser lets a page sound only after the operator has touched it.
    const wake = function () {
      context = context || new AudioContext();
      if (context.state === "suspended") context.resume();
    };
    for (const name of ["pointerdown", "keydown"]) window.addEventListener(name, wake, { capture: true });
    return {
      get muted() { return muted; },
      set muted(value) { muted = value; },
      play(pitches) {
        if (muted || !context || context.state !== "running") return false;
        pitches.forEach((pitch, index) => {
          const tone = context.createOscillator(), volume = context.createGain(), at = context.currentTime + index * NOTE_S * 1.25;
          tone.frequency.value = pitch;
          volume.gain.setValueAtTime(0.25, at);
          volume.gain.exponentialRampToValueAtTime(0.01, at + NOTE_S);
          tone.connect(volume).connect(context.destination);
          tone.start(at);
          tone.stop(at + NOTE_S);
        });
        return true;
      },
    };
  };

  // Lists of warnings and cautions; `show([{key, level, text, since}], now)`. Advisories are no alarms.
  canine.alarms = function ({ warnings, cautions, calm }, sound) {
    const known = { warning: new Map(), caution: new Map() };
    let called = -Infinity;
    function update(list, level, alarms, now) {
      const before = known[level], after = new Map(), added = [];
      for (const { key, text, since } of alarms) {
        const id = key || text, item = before.get(id) || canine.element("li", { class: level + "-alarm" });
        const age = canine.isNumber(since) && canine.isNumber(now) ? Math.max(0, now - since) : null;
        if (!before.has(id)) {
          added.push(item);
          item.append(canine.element("strong", {}, level === "warning" ? "WARNING" : "CAUTION"), " ", canine.element("span", {}, ""),
            canine.element("span", { class: "age number", "aria-hidden": "true" }, ""));
        }
        const [, words, time] = item.children;
        if (words.textContent !== text) words.textContent = text;
        time.textContent = age === null ? "" : `for ${age.toFixed(0)} s`;
        after.set(id, item);
      }
      for (const [id, item] of before) if (!after.has(id)) item.remove();
      list.append(...added);
      known[level] = after;
      return added.length > 0;
    }
    return {
      show(alarms, now) {
        const warned = update(warnings, "warning", alarms.filter(({ level }) => level === "warning"), now);
        const cautioned = update(cautions, "caution", alarms.filter(({ level }) => level === "caution"), now);
        calm.hidden = known.warning.size + known.caution.size > 0;
        const clock = performance.now();
        if (known.warning.size && (warned || clock - called > WARNING.every)) {
          called = clock;
          sound.play(WARNING.pitch);
        } else if (cautioned) sound.play(CAUTION.pitch);
      },
    };
  };
})();
