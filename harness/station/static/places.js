// The mission as a table: each place can be typed, moved in the order and deleted by keyboard alone.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const LIMITS = [90, 180]; // deg
  const AXES = ["latitude", "longitude"];

  // `complain` is told what is wrong with a number.
  canine.places = function (table, total, draft, complain) {
    const body = table.tBodies[0];
    let mayEdit = false, radius = 0;

    function draw() {
      const { home, waypoints, fence } = draft.value, legs = canine.legs(draft.value), first = home ? 0 : 1;
      const focus = body.contains(document.activeElement) ? document.activeElement.dataset.key : null;
      const rows = [];
      if (home) rows.push(row("home", 0, "H", home, null));
      waypoints.forEach((place, index) => rows.push(row("waypoints", index, String(index + 1), place, legs[index - first])));
      if (home && waypoints.length) rows.push(wayBack(legs.at(-1)));
      fence.forEach((place, index) => rows.push(row("fence", index, "F" + (index + 1), place, null)));
      body.replaceChildren(...rows);
      const led = legs.reduce((sum, leg) => sum + leg.length, 0);
      total.textContent = waypoints.length
        ? `${waypoints.length} ${waypoints.length > 1 ? "waypoints" : "waypoint"}, ${canine.format(led, "m", 1)} in all` +
          (home ? " with the way home" : "; home is not marked") + (fence.length ? `, fence of ${fence.length} ${fence.length > 1 ? "corners" : "corner"}` : ", no fence")
        : "No waypoint yet: choose Waypoint and click on the map";
      const again = focus && body.querySelector(`[data-key="${focus}"]`);
      if (again) again.focus();
    }
    function row(kind, index, label, place, leg) {
      const name = canine.placeName(kind, index);
      const cells = AXES.map((axis, which) => {
        const input = canine.element("input", { type: "text", inputmode: "decimal", value: place[which].toFixed(7), size: 11,
          "aria-label": `${axis} of ${name} in deg`, "data-key": `${kind}-${index}-${axis}`, disabled: !mayEdit });
        input.addEventListener("change", () => {
          const degrees = Number(input.value.replace(",", ".")), limit = LIMITS[which];
          const right = input.value.trim() !== "" && Math.abs(degrees) <= limit;
          input.setAttribute("aria-invalid", String(!right));
          if (!right) return complain(`${axis} of ${name} is "${input.value}", expected a number from -${limit} to ${limit} deg`);
          complain("");
          draft.move(kind, index, place.with(which, degrees));
        });
        return canine.element("td", {}, input);
      });
      const buttons = [];
      const button = function (text, what, act, off) {
        const made = canine.element("button", { type: "button", "aria-label": `${what} ${name}`, title: `${what} ${name}`,
          "data-key": `${kind}-${index}-${what}`, disabled: !mayEdit || off }, text);
        made.addEventListener("click", act);
        buttons.push(made);
      };
      if (kind === "waypoints") button("\u2191", "earlier", () => exchange(index, index - 1), index === 0);
      button("\u00d7", "delete", () => draft.remove(kind, index));
      const short = leg && leg.length <= radius;
      return canine.element("tr", { class: kind },
        canine.element("th", { scope: "row" }, label), ...cells,
        canine.element("td", { class: short ? "number caution" : "number", title: short ? "not longer than the capture radius" : null },
          leg ? leg.length.toFixed(1) : ""),
        canine.element("td", { class: "number" }, leg ? turn(leg.turn) : ""),
        canine.element("td", { class: "buttons" }, ...buttons));
    }
    const wayBack = (leg) => canine.element("tr", { class: "back" },
      canine.element("th", { scope: "row" }, "H"), canine.element("td", { colspan: 2, class: "soft" }, "the way home"),
      canine.element("td", { class: "number" }, leg.length.toFixed(1)),
      canine.element("td", { class: "number" }, turn(leg.turn)), canine.element("td", {}));
    const turn = (angle) => (angle === null ? "" : `${canine.toShown(Math.abs(angle), "rad").toFixed(0)} ${angle < 0 ? "L" : "R"}`);
    function exchange(one, other) {
      const { waypoints } = draft.value;
      draft.change({ waypoints: waypoints.with(one, waypoints[other]).with(other, waypoints[one]) });
    }
    draft.listen(draw);
    draw();
    return {
      set mayEdit(value) {
        if (mayEdit === value) return;
        mayEdit = value;
        draw();
      },
      set radius(value) {
        radius = value;
        draw();
      },
    };
  };
})();
