// The trial over time: what the vest told, row by row; its plots and the strip of commands.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const MOST_ROWS = 36000; // two hours of telemetry; then every other row goes
  const COLUMNS = ["time", "latitude", "longitude", "speed", "heading", "position_sd", "deviation", "distance", "command", "mode", "waypoint"];
  const AIMLESS = ["IDLE", "SUCCESS", "FAILED", "STOPPED"]; // modes without a target
  const SILENT_S = 2; // between two rows: more is a gap
  const SHOWN_S = 120; // of a trial that goes on

  canine.course = function (strip, plots) {
    let timeline = null, panels = null, blocks = null, thresholds = {};
    let rows = Object.fromEntries(COLUMNS.map((name) => [name, []]));
    const levels = () => [["moving_deviation", "a turn begins"], ["stop_deviation", ""]]
      .filter(([name]) => canine.isNumber(thresholds[name]))
      .flatMap(([name, label]) => [{ value: thresholds[name], label }, { value: -thresholds[name] }]);

    function build(from, until) {
      timeline = canine.timeline(from, until);
      blocks = canine.strip(strip, timeline);
      panels = canine.plots(plots, timeline);
      panels.deviation = panels.add({ title: "Deviation from the target", unit: "rad", height: 100, turn: 2 * Math.PI, include: [-60, 60],
        get levels() { return levels(); }, series: [{ label: "deviation", colour: "estimate" }] });
      panels.speed = panels.add({ title: "Speed", unit: "m/s", height: 64, include: [0], series: [{ label: "estimate", colour: "estimate" }] });
      for (const element of [plots, strip]) {
        element.addEventListener("mouseleave", () => {
          if (!course.fixed) timeline.move(timeline.until);
        });
      }
    }
    function thin() {
      const keep = (_, row) => row % 2 === 0 || row > MOST_ROWS / 2;
      for (const name of COLUMNS) rows[name] = rows[name].filter(keep);
    }
    const course = {
      fixed: false, // a log whose end is known
      get rows() { return rows; },
      setThresholds(value) { thresholds = value; },
      // All of a log, or what was told before this page was there.
      take(columns) {
        rows = Object.fromEntries(COLUMNS.map((name) => [name, [...(columns[name] || [])]]));
        course.draw();
      },
      add(row) {
        const last = rows.time.at(-1);
        if (canine.isNumber(last) && row.time <= last) return false;
        for (const name of COLUMNS) rows[name].push(row[name] === undefined ? null : row[name]);
        if (rows.time.length > MOST_ROWS) thin();
        return true;
      },
      draw() {
        const { time, deviation, speed, command, mode } = rows;
        if (time.length < 2) return;
        const follows = !timeline || timeline.time >= timeline.until;
        if (!timeline) build(time[0], time.at(-1));
        const known = (value, row) => (row && time[row] - time[row - 1] > SILENT_S ? null : value);
        panels.deviation.set(time, [deviation.map((value, row) => (AIMLESS.includes(mode[row]) ? null : known(value, row)))]);
        panels.speed.set(time, [speed.map(known)]);
        blocks.set({ command: canine.commandBlocks(time, command) });
        if (!course.fixed) {
          timeline.extend(time.at(-1));
          if (!follows) return;
          timeline.show(Math.max(time[0], time.at(-1) - SHOWN_S), time.at(-1));
          timeline.move(time.at(-1));
        }
      },
      move: (time) => timeline && timeline.move(time),
    };
    return course;
  };
})();
