// The map of the station: what is drawn, what is on board, the animal and its track; places are edited on it.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const STEP = 0.5, LONG_STEP = 5; // m, that an arrow key moves a place
  const ARROWS = { ArrowUp: [1, 0], ArrowDown: [-1, 0], ArrowRight: [0, 1], ArrowLeft: [0, -1] };
  const NEAR = 0.2; // m, below which the track gets no point

  canine.chart = function (element, draft, origin) {
    const map = canine.map(element, { plane: canine.plane(origin) }), { leaflet, content } = map;
    const shapes = L.featureGroup().addTo(content), differing = L.featureGroup().addTo(content);
    const handles = { home: [], waypoints: [], fence: [] };
    const track = map.track("path"), animal = map.animal("estimate");
    const target = L.polyline([], { className: "to-target", interactive: false, color: null }).addTo(leaflet);
    let tool = "move", mayEdit = false, radius = 0, onBoard = null, last = null, homeAtHand = null, limits = { waypoints: 16, corners: 7 };
    let addToArea = () => {}, open = null; // the line of the track that grows

    const line = (points, className, more) => L.polyline(points, { className, interactive: false, color: null, fillColor: null, ...more });
    const isOnBoard = (kind, index) =>
      Boolean(onBoard) && canine.samePlace(kind === "home" ? draft.value.home : draft.value[kind][index], kind === "home" ? onBoard.home : onBoard[kind][index]);
    const circle = (place, className) => L.circle(place, { radius, className, interactive: false, color: null, fillColor: null });

    // What is on screen; what is on board and differs from it is dashed.
    function draw() {
      const { home, waypoints, fence } = draft.value, places = [...(home ? [home] : []), ...waypoints];
      shapes.clearLayers();
      differing.clearLayers();
      if (onBoard) drawDiffering();
      if (fence.length > 1) L.polygon(fence, { className: "fence", interactive: false, color: null, fillColor: null }).addTo(shapes);
      if (radius) places.forEach((place) => circle(place, "capture").addTo(shapes));
      places.slice(1).forEach((place, index) => {
        const leg = [places[index], place], at = index + (home ? 0 : 1);
        line(leg, "leg drawn").addTo(shapes);
        if (tool === "waypoint" && mayEdit) {
          line(leg, "leg-grip", { interactive: true, bubblingMouseEvents: false, weight: 18 })
            .on("click", ({ latlng }) => insert(at, [latlng.lat, latlng.lng])).addTo(shapes);
        }
      });
      if (home && waypoints.length) line([waypoints.at(-1), home], "leg back").addTo(shapes);
      place("home", home ? [home] : []);
      place("waypoints", waypoints);
      place("fence", fence);
    }
    function drawDiffering() {
      const { home, waypoints, fence } = onBoard;
      waypoints.forEach((place, index) => {
        if (isOnBoard("waypoints", index)) return;
        circle(place, "capture differs").addTo(differing);
        const icon = L.divIcon({ className: "", iconSize: [20, 20], html: canine.element("div", { class: "waypoint differs" }, index + 1) });
        L.marker(place, { icon, interactive: false, keyboard: false }).addTo(differing);
      });
      const route = [home, ...waypoints];
      const same = canine.sameMission({ ...onBoard, fence: [] }, { ...draft.value, fence: [] });
      if (!same) line(route, "leg differs").addTo(differing);
      if (fence.length && JSON.stringify(fence) !== JSON.stringify(draft.value.fence)) {
        L.polygon(fence, { className: "fence differs", interactive: false, color: null, fillColor: null }).addTo(differing);
      }
    }

    // The handles of a kind follow its places; they are kept, so that the focus is.
    function place(kind, places) {
      const some = handles[kind];
      while (some.length > places.length) some.pop().remove();
      places.forEach((where, index) => {
        if (!some[index]) some[index] = handle(kind, index);
        some[index].setLatLng(where);
        const face = some[index].getElement();
        face.firstChild.className = faceOf(kind, index);
        face.setAttribute("aria-label", canine.placeName(kind, index) + (isOnBoard(kind, index) ? ", on board" : ", not on board"));
        some[index].dragging[mayEdit ? "enable" : "disable"]();
      });
    }
    const faceOf = (kind, index) =>
      (kind === "fence" ? "corner" : kind === "home" ? "waypoint home" : "waypoint") + (isOnBoard(kind, index) ? "" : " new");
    function handle(kind, index) {
      const text = kind === "home" ? "H" : kind === "fence" ? "" : String(index + 1);
      const icon = L.divIcon({ className: "handle", iconSize: [34, 34], html: canine.element("div", { class: faceOf(kind, index) }, text) });
      const marker = L.marker([0, 0], { icon, draggable: true, autoPan: true, title: canine.placeName(kind, index) }).addTo(content);
      const moved = ([latitude, longitude]) => draft.move(kind, index, [latitude, longitude]);
      marker.on("dragend", () => moved([marker.getLatLng().lat, marker.getLatLng().lng]));
      marker.getElement().addEventListener("keydown", (event) => {
        const arrow = ARROWS[event.key];
        if (!mayEdit || (!arrow && event.key !== "Delete")) return;
        event.preventDefault();
        event.stopPropagation();
        if (!arrow) return draft.remove(kind, index);
        const { lat, lng } = marker.getLatLng(), plane = canine.plane([lat, lng]), step = event.shiftKey ? LONG_STEP : STEP;
        moved(plane.toDegrees(arrow.map((part) => part * step)));
      });
      return marker;
    }
    function insert(index, where) {
      const { home, waypoints } = draft.value;
      if (waypoints.length >= limits.waypoints) return;
      draft.change({ home: home || homeAtHand, waypoints: waypoints.toSpliced(index, 0, where) });
    }
    function add(kind, where) {
      if (kind === "home") draft.change({ home: where });
      else if (kind === "area") addToArea(where);
      else if (kind === "waypoint") insert(draft.value.waypoints.length, where);
      else if (draft.value.fence.length < limits.corners) draft.insert("fence", draft.value.fence.length, where);
    }
    leaflet.on("click", ({ latlng }) => {
      if (tool !== "move" && mayEdit) add(tool, [latlng.lat, latlng.lng]);
    });
    draft.listen(draw);

    return {
      map,
      add,
      centre: () => [leaflet.getCenter().lat, leaflet.getCenter().lng],
      set limits(value) { limits = value; },
      // What takes the corners of an area to keep out of, which is no part of the mission.
      set area(take) { addToArea = take; },
      // What becomes home with the first waypoint, if none is marked.
      set homeAtHand(place) { homeAtHand = place; },
      set tool(value) {
        tool = value;
        element.classList.toggle("marks", tool !== "move");
        draw();
      },
      set radius(value) {
        radius = value;
        draw();
      },
      // May this operator draw?
      set mayEdit(value) {
        if (mayEdit === value) return;
        mayEdit = value;
        draw();
      },
      set onBoard(mission) {
        if (onBoard === mission || canine.sameMission(onBoard, mission)) return;
        onBoard = mission;
        draw();
      },
      // Streets and poles of a simulated animal, which are not on board: under all else.
      set world({ streets, poles }) {
        streets.forEach((outline) => L.polygon(outline, { className: "street", pane: "trails", interactive: false, color: null, fillColor: null }).addTo(content));
        poles.forEach((place) => map.mark(place, "\u25b2", "pole of the simulated dog"));
      },
      setTrack(points, commands) {
        track.set(points, commands);
        open = last = null;
      },
      follow(point, command) {
        const turned = !last || command !== last[1];
        if (!point) return void (open = last = null);
        if (!turned && Math.hypot(...canine.plane(last[0]).toMetres(point)) <= NEAR) return;
        if (turned) {
          open = line(last ? [last[0], point] : [point], "track path command-" + command).addTo(track.layer);
          track.turn(command, point);
        } else open.addLatLng(point);
        last = [point, command];
      },
      // The animal, its 2-sigma circle, and where it is led.
      show(point, heading, sd, aim) {
        animal.place(point, heading, canine.isNumber(sd) ? [sd, sd] : null);
        target.setLatLngs(point && aim ? [point, aim] : []);
      },
      // Keeps the animal on the map.
      keep(point) {
        if (point && !leaflet.getBounds().pad(-0.1).contains(point)) leaflet.panTo(point);
      },
    };
  };
})();
