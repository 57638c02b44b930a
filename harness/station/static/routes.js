// Routes round buildings: a map's areas, and the ways that the station proposes over it from home to the last waypoint.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const percent = (rate) => (rate > 0 && rate < 0.001 ? "< 0.1 %" : rate < 1 && rate > 0.999 ? "> 99.9 %" : (100 * rate).toFixed(1) + " %");
  const mean = (value, digits, unit) => (canine.isNumber(value) ? value.toFixed(digits) + unit : "\u2013");
  canine.routeInWords = (route) =>
    `${percent(route.success_rate)} get there, ${percent(route.entry_rate)} enter an area, ${mean(route.mean_time_s, 0, " s")}, ` +
    `${mean(route.mean_commands, 1, "")} stimuli: ${route.label}`;

  const CORNERS = 3; // of an area at least

  // `parts`: {file, end, clear, propose, use, list, said}; `ask(path, body, what)` posts. Gives {addCorner, mayEdit}.
  canine.routes = function (leaflet, draft, { file, end, clear, propose, use, list, said }, ask) {
    const areas = L.featureGroup().addTo(leaflet), lines = L.featureGroup().addTo(leaflet);
    const plain = { interactive: false, color: null, fillColor: null };
    let map = null, routes = [], home = null, chosen = null, isAsking = false, mayEdit = false;
    let drawn = [], open = []; // areas that are drawn here, and the corners of the one that is not closed

    function draw() {
      const { home, waypoints } = draft.value;
      file.disabled = !mayEdit || isAsking;
      end.disabled = !mayEdit || isAsking || open.length < CORNERS;
      clear.disabled = !mayEdit || isAsking || !(drawn.length || open.length);
      propose.disabled = !mayEdit || isAsking || !(map || drawn.length) || open.length > 0 || !home || !waypoints.length;
      use.disabled = !mayEdit || chosen === null;
    }
    // The areas that are drawn; the routes before them are gone.
    function sketch() {
      areas.clearLayers();
      lines.clearLayers();
      list.replaceChildren();
      [routes, chosen] = [[], null];
      for (const ring of drawn) L.polygon(ring, { ...plain, className: "area" }).addTo(areas);
      if (open.length) L.polyline(open, { ...plain, className: "area open" }).addTo(areas);
      for (const corner of open) L.circleMarker(corner, { ...plain, radius: 4, className: "area" }).addTo(areas);
      draw();
    }
    function addCorner(place) {
      if (!mayEdit || isAsking) return;
      if (map) [map, file.value] = [null, ""]; // areas are of a file, or drawn
      open = [...open, place];
      said.textContent = open.length < CORNERS ? `Corner ${open.length} of an area` : `Corner ${open.length}: end the area, or go on`;
      sketch();
    }
    // In GeoJSON: longitude first, and the first corner again.
    const mapOf = (rings) => new File([JSON.stringify({ type: "FeatureCollection", features: rings.map((ring, index) => ({
      type: "Feature", properties: { name: `area ${index + 1}` },
      geometry: { type: "Polygon", coordinates: [[...ring, ring[0]].map(([latitude, longitude]) => [longitude, latitude])] },
    })) })], "drawn.geojson");
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
      list.scrollIntoView({ block: "nearest" }); // it may be below what the panel shows
      said.textContent = [best < 0 ? "No route is recommended" : `Route ${best + 1} of ${routes.length} is recommended`, ...answer.notes,
        ...answer.assumes.map((text) => "it is assumed that " + text)].join("; ");
    }
    file.addEventListener("change", () => {
      [map = null] = file.files;
      if (map) {
        drawn = open = [];
        sketch();
      }
      said.textContent = map ? `${map.name}: routes are proposed from home to the last waypoint` : "";
      draw();
    });
    end.addEventListener("click", () => {
      drawn = [...drawn, open];
      open = [];
      said.textContent = `${drawn.length} ${drawn.length > 1 ? "areas are" : "area is"} drawn`;
      sketch();
    });
    clear.addEventListener("click", () => {
      drawn = open = [];
      said.textContent = "";
      sketch();
    });
    propose.addEventListener("click", async () => {
      const begin = draft.value.home, goal = draft.value.waypoints.at(-1), asked = map || mapOf(drawn);
      isAsking = true;
      said.textContent = "Routes are tried ...";
      draw();
      try {
        const path = `/routes?name=${encodeURIComponent(asked.name)}&from=${begin.join()}&to=${goal.join()}`;
        take(await (await ask(path, asked, "Routes")).json(), begin);
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
      addCorner,
      set mayEdit(may) {
        if (may === mayEdit) return;
        mayEdit = may;
        draw();
      },
    };
  };
})();
