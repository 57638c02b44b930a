// The mission on screen: home, waypoints and fence in deg, with undo; its legs.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const MOST_STEPS = 100; // that can be undone
  const DIGITS = 7; // of a degree, as the radio sends
  const EMPTY = { home: null, waypoints: [], fence: [] };

  canine.rounded = ([latitude, longitude]) => [latitude, longitude].map((degrees) => Number(degrees.toFixed(DIGITS)));
  canine.samePlace = (one, other) => Boolean(one && other) && one[0] === other[0] && one[1] === other[1];
  const clean = (mission) => ({
    home: mission.home ? canine.rounded(mission.home) : null,
    waypoints: (mission.waypoints || []).map(canine.rounded),
    fence: (mission.fence || []).map(canine.rounded),
  });
  canine.sameMission = (one, other) => Boolean(one && other) && JSON.stringify(clean(one)) === JSON.stringify(clean(other));

  canine.placeName = (kind, index) =>
    ({ home: "home", waypoints: "waypoint " + (index + 1), fence: "fence corner " + (index + 1) })[kind];

  // A draft: `value`, `change(next)`, `undo()`, `redo()`, `adopt(mission)` for one that another drew, `listen(react)`.
  canine.draft = function () {
    const listeners = new Set(), done = [], undone = [];
    const tell = (mine) => listeners.forEach((react) => react(draft.value, mine));
    const draft = {
      value: EMPTY,
      get canUndo() { return done.length > 0; },
      get canRedo() { return undone.length > 0; },
      listen: (react) => listeners.add(react),
      change(next) {
        const value = clean({ ...draft.value, ...next });
        if (canine.sameMission(value, draft.value)) return;
        done.push(draft.value);
        if (done.length > MOST_STEPS) done.shift();
        undone.length = 0;
        draft.value = value;
        tell(true);
      },
      undo: () => swap(done, undone),
      redo: () => swap(undone, done),
      adopt(mission) {
        const value = clean(mission);
        if (canine.sameMission(value, draft.value)) return;
        done.length = undone.length = 0;
        draft.value = value;
        tell(false);
      },
      insert: (kind, index, place) => draft.change({ [kind]: draft.value[kind].toSpliced(index, 0, place) }),
      move: (kind, index, place) =>
        draft.change(kind === "home" ? { home: place } : { [kind]: draft.value[kind].with(index, place) }),
      remove: (kind, index) =>
        draft.change(kind === "home" ? { home: null } : { [kind]: draft.value[kind].toSpliced(index, 1) }),
    };
    function swap(from, to) {
      if (!from.length) return;
      to.push(draft.value);
      draft.value = from.pop();
      tell(true);
    }
    return draft;
  };

  // The legs from home over the waypoints and back: {length [m], turn [rad, right positive, at their start]}.
  canine.legs = function ({ home, waypoints }) {
    const places = home ? [home, ...waypoints, home] : waypoints;
    if (places.length < 2) return [];
    const plane = canine.plane(places[0]), metres = places.map(plane.toMetres);
    let before = null;
    return metres.slice(1).map(([north, east], index) => {
      const along = [north - metres[index][0], east - metres[index][1]];
      const bearing = Math.atan2(along[1], along[0]);
      const turn = before === null ? null : bearing - before - 2 * Math.PI * Math.round((bearing - before) / (2 * Math.PI));
      before = bearing;
      return { length: Math.hypot(...along), turn };
    });
  };
})();
