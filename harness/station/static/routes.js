// Routes round buildings: a map's areas, and the ways that the station proposes over it from home to the last waypoint.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const percent = (rate) => (rate > 0 && rate < 0.001 ? "< 0.1 %" : rate < 1 && rate > 0.999 ? "> 99.9 %" : (100 * rate).toFixed(1) + " %");
  const mean = (value, digits, unit) => (canine.isNumber(value) ? value.toFixed(digits) + unit : "\u2013");
  canine.routeInWords = (route) =>
    `${percent(route.success_rate)} get there, ${percent(route.entry_rate)} enter an area, ${mean(route.mean_time_s, 0, " s")}, ` +
    `${mean(route.mean_commands, 1, "")} stimuli: ${route.label}`;

  // `parts`: {file, propose, use, list, said}; `ask(path, body, what)` posts. Gives {mayEdit}.
  canine.routes = function (leaflet, draft, { file, propose, use, list, said }, ask) {
    const areas = L.featureGroup().addTo(leaflet), lines = L.featureGroup().addTo(leaflet);
    const plain = { interactive: false, color: null, fillColor: null };
    let map = null, routes = [], home = null, chosen = null, isAsking = false, mayEdit = false;

    function draw() {
      const { home, waypoints } = draft.value;
      file.disabled = !mayEdit || isAsking;
      propose.disabled = !mayEdit || isAsking || !map || !home || !waypoints.length;
      use.disabled = !mayEdit || chosen === null;
    }
    function show(index) {
      chosen = index;
      lines.clearLayers();
      routes.forEach(({ waypoints }, number) => {
        if (number !== chosen) L.polyline([home, ...waypoints], { ...plain, className: "proposal" }).addTo(lines);
      });
      if (chosen !== null) L.polyline([home, ...routes[chosen].waypoints], { ...plain, className: "proposal chosen" }).addTo(lines);
      [...list.children].forEach((item, number) => item.firstChild.setAttribute("aria-pressed", String(number === chosen)));
      draw();
    }
    function take(answer, begin) {
      routes = answer.routes;
      home = begin;
      areas.clearLayers();
      answer.areas.forEach(({ rings }) => L.polygon(rings, { ...plain, className: "area" }).addTo(areas));
      list.replaceChildren(...routes.map((route, index) => {
        const button = canine.element("button", { type: "button", "aria-pressed": "false" }, canine.routeInWords(route));
        button.addEventListener("click", () => show(index));
        return canine.element("li", {}, button);
      }));
      const best = routes.findIndex(({ recommended }) => recommended);
      show(best < 0 ? null : best);
      const bounds = areas.getBounds().extend(lines.getBounds());
      if (bounds.isValid()) leaflet.fitBounds(bounds.pad(0.1));
      said.textContent = [best < 0 ? "No route is recommended" : `Route ${best + 1} of ${routes.length} is recommended`, ...answer.notes,
        ...answer.assumes.map((text) => "it is assumed that " + text)].join("; ");
    }
    file.addEventListener("change", () => {
      [map = null] = file.files;
      said.textContent = map ? `${map.name}: routes are proposed from home to the last waypoint` : "";
      draw();
    });
    propose.addEventListener("click", async () => {
      const begin = draft.value.home, end = draft.value.waypoints.at(-1);
      isAsking = true;
      said.textContent = "Routes are tried ...";
      draw();
      try {
        const path = `/routes?name=${encodeURIComponent(map.name)}&from=${begin.join()}&to=${end.join()}`;
        take(await (await ask(path, map, "Routes")).json(), begin);
      } catch (error) {
        said.textContent = error.message;
      }
      isAsking = false;
      draw();
    });
    use.addEventListener("click", () => {
      draft.change({ home, waypoints: routes[chosen].waypoints });
      said.textContent = `Route ${chosen + 1} is the mission on screen: it can be edited, and is uploaded as any other`;
    });
    draft.listen(draw);
    return {
      set mayEdit(may) {
        if (may === mayEdit) return;
        mayEdit = may;
        draw();
      },
    };
  };
})();
