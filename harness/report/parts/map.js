// A map of metres north and east, or of latitude and longitude: grid, tracks, missions, the animal.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const LEAST_VIEW = 10; // m, so that an animal that stands still is no magnified point
  const MOST_GLYPHS = 300; // of turns on a track; more would hide it
  const ARROW = "M0 -13 8 9 0 4 -8 9z";

  const isPlace = (place) => place && canine.isNumber(place[0]) && canine.isNumber(place[1]);

  // A map in an element. Positions are [north, east] in m, or with a `plane` [latitude, longitude] in deg.
  canine.map = function (element, { plane = null, label = "map" } = {}) {
    const limits = plane ? { minZoom: 2, maxZoom: 23 } : { minZoom: -8, maxZoom: 8 };
    element.classList.add("map");
    element.setAttribute("role", "region");
    element.setAttribute("aria-label", label);
    const leaflet = L.map(element, {
      crs: plane ? L.CRS.EPSG3857 : L.CRS.Simple, attributionControl: false, zoomSnap: 0.25, zoomDelta: 0.5, ...limits,
    });
    let isFitted = false;
    for (const [name, level] of [["grid", 150], ["trails", 350], ["marks", 620]]) {
      leaflet.createPane(name).style.zIndex = level;
    }
    leaflet.setView(plane ? plane.toDegrees([0, 0]) : [0, 0], plane ? 18 : 3);
    L.control.scale({ imperial: false }).addTo(leaflet);
    const content = L.featureGroup().addTo(leaflet);
    const path = (className, more) => ({ className, interactive: false, color: null, fillColor: null, ...more });

    const map = {
      leaflet,
      content,
      toMetres: (place) => (plane ? plane.toMetres(place) : place),
      fromMetres: (place) => (plane ? plane.toDegrees(place) : place),
      setPlane(next) {
        plane = next;
        drawGrid();
      },
      // Shows all that is drawn, and again when the map's size changes, until somebody moves it.
      fit() {
        const bounds = content.getBounds();
        if (!bounds.isValid()) return;
        const [n, e] = map.toMetres([bounds.getCenter().lat, bounds.getCenter().lng]), half = LEAST_VIEW / 2;
        bounds.extend(map.fromMetres([n - half, e - half])).extend(map.fromMetres([n + half, e + half]));
        leaflet.fitBounds(bounds, { padding: [24, 24], animate: false });
        isFitted = true;
      },
      // A line, coloured by the command in force if `commands` are given: set(points, commands). `turn` draws the sign of a turn.
      track(className) {
        const group = L.featureGroup().addTo(content);
        const draw = function (name, points) {
          const colour = name === null ? "" : " command-" + name;
          L.polyline(points, path("track " + (className || "") + colour)).addTo(group);
        };
        const track = {
          layer: group,
          turn(name, place) {
            if (name === "LEFT" || name === "RIGHT") glyph(place, canine.GLYPHS[name], "turn", name.toLowerCase()).addTo(group);
          },
          set(points, commands) {
            group.clearLayers();
            if (!commands) return draw(null, pieces(points, 0, points.length - 1));
            const lines = new Map(), parts = canine.stretches(commands);
            for (const { first, last, value } of parts) {
              if (!lines.has(value)) lines.set(value, []);
              lines.get(value).push(...pieces(points, first, last));
            }
            for (const [name, line] of lines) if (line.length) draw(name, line);
            const turns = parts.filter(({ value, first }) => (value === "LEFT" || value === "RIGHT") && isPlace(points[first]));
            if (turns.length <= MOST_GLYPHS) turns.forEach(({ value, first }) => track.turn(value, points[first]));
          },
        };
        return track;
      },
      // Dots, such as GPS fixes.
      dots(className, points) {
        const renderer = L.svg({ pane: "trails" });
        return L.featureGroup(
          points.filter(isPlace).map((point) => L.circleMarker(point, path(className, { radius: 2, renderer })))
        ).addTo(content);
      },
      // Broad bands under the track, such as where a fault acted: arrays of points.
      trails(className, lines) {
        const drawn = lines.map((line) => line.filter(isPlace)).filter((line) => line.length);
        return L.polyline(drawn.map((line) => (line.length > 1 ? line : [line[0], line[0]])),
          path("trail " + className, { pane: "trails" })).addTo(content);
      },
      // A sign with a name, such as an anomaly.
      mark: (place, sign, name) => (isPlace(place) ? glyph(place, sign, "mark", name).addTo(content) : null),
      // Waypoints with their capture circles, home, legs and fence, outlines of streets, poles.
      mission({ waypoints = [], home = null, radius = 0, fence = [], streets = [], poles = [] }) {
        const group = L.featureGroup().addTo(content), places = [...waypoints, ...(home ? [home] : [])];
        streets.forEach((street) => L.polygon(street, path("street", { pane: "grid" })).addTo(group));
        poles.forEach((place) => glyph(place, "\u25b2", "mark", "pole").addTo(group));
        if (fence.length) L.polygon(fence, path("fence")).addTo(group);
        if (radius) places.forEach((place) => L.circle(place, path("capture", { radius })).addTo(group));
        L.polyline(places, path("leg")).addTo(group);
        places.forEach((place, index) => {
          const isHome = index === waypoints.length;
          const text = isHome ? "H" : String(index + 1), name = isHome ? "home" : "waypoint " + text;
          glyph(place, text, "waypoint" + (isHome ? " home" : ""), name, 22).addTo(group);
        });
        return group;
      },
      // An arrow as the animal looks, and its 2-sigma ellipse: place(position, heading, [north sd, east sd]), rad and m.
      animal(className) {
        const svg = L.SVG.create("svg"), arrow = L.SVG.create("path");
        svg.setAttribute("viewBox", "-14 -14 28 28");
        svg.setAttribute("aria-hidden", "true");
        arrow.setAttribute("d", ARROW);
        svg.append(arrow);
        const icon = L.divIcon({ className: "", iconSize: [28, 28], html: canine.element("div", { class: "animal " + (className || "") }, svg) });
        const marker = L.marker([0, 0], { icon, interactive: false, keyboard: false, pane: "marks" });
        const ellipse = L.polygon([], path("sigma"));
        return {
          place(position, heading, sigma) {
            if (!isPlace(position)) return [marker, ellipse].forEach((layer) => layer.remove());
            marker.setLatLng(position).addTo(leaflet);
            arrow.style.transform = canine.isNumber(heading) ? `rotate(${heading}rad)` : "";
            arrow.setAttribute("d", canine.isNumber(heading) ? ARROW : "M-7 0a7 7 0 1 0 14 0a7 7 0 1 0-14 0");
            if (!isPlace(sigma)) return ellipse.remove();
            const [n, e] = map.toMetres(position);
            const around = Array.from({ length: 36 }, (_, i) => (i * Math.PI) / 18).map((angle) =>
              map.fromMetres([n + 2 * sigma[0] * Math.cos(angle), e + 2 * sigma[1] * Math.sin(angle)]));
            return ellipse.setLatLngs(around).addTo(leaflet);
          },
        };
      },
    };

    function glyph(place, sign, className, name, size = 16) {
      const icon = L.divIcon({ className: "", iconSize: [size, size], html: canine.element("div", { class: className, title: name }, sign) });
      return L.marker(place, { icon, interactive: false, keyboard: false, alt: name });
    }
    // A line's points from first to last, cut where there is no place.
    function pieces(points, first, last) {
      const found = [[]];
      for (let row = first; row <= last; row++) {
        if (isPlace(points[row])) found.at(-1).push(points[row]);
        else if (found.at(-1).length) found.push([]);
      }
      return found.filter((piece) => piece.length > 1);
    }

    const grid = L.layerGroup().addTo(leaflet);
    function drawGrid() {
      grid.clearLayers();
      const bounds = leaflet.getBounds();
      const [south, west] = map.toMetres([bounds.getSouth(), bounds.getWest()]);
      const [north, east] = map.toMetres([bounds.getNorth(), bounds.getEast()]);
      const raw = ((east - west) / Math.max(leaflet.getSize().x, 1)) * 60, power = 10 ** Math.floor(Math.log10(raw));
      const step = power * [1, 2, 5, 10].find((digit) => digit * power >= raw);
      if (!Number.isFinite(step) || east - west > 1e6) return;
      const line = function (from, to, value) {
        const className = "grid" + (Math.abs(value) < step / 2 ? " grid-origin" : "");
        L.polyline([map.fromMetres(from), map.fromMetres(to)], path(className, { pane: "grid" })).addTo(grid);
      };
      for (let n = Math.ceil(south / step) * step; n <= north; n += step) line([n, west], [n, east], n);
      for (let e = Math.ceil(west / step) * step; e <= east; e += step) line([south, e], [north, e], e);
    }
    leaflet.on("moveend resize", drawGrid);
    drawGrid();

    const readout = L.control({ position: "bottomright" });
    readout.onAdd = () => canine.element("div", { class: "place number", "aria-hidden": "true" });
    readout.addTo(leaflet);
    leaflet.on("mousemove", ({ latlng }) => {
      const [n, e] = map.toMetres([latlng.lat, latlng.lng]);
      readout.getContainer().textContent = `north ${n.toFixed(1)} m, east ${e.toFixed(1)} m`;
    });
    leaflet.on("movestart zoomstart", () => (isFitted = false));
    new ResizeObserver(() => {
      const wasFitted = isFitted;
      leaflet.invalidateSize({ pan: false });
      if (wasFitted) map.fit();
    }).observe(element);
    return map;
  };
})();
