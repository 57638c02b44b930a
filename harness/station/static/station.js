// The station's page: what the server tells is shown, what the operator does is sent.
(function () {
  "use strict";
  const canine = window.canine, id = (name) => document.getElementById(name);
  const HOLD_S = 1; // of START
  const ALIVE_MS = 200, DRAW_MS = 100, COURSE_MS = 500, DRAFT_MS = 250, SEEK_MS = 100; // between two of a kind
  const MOST_EVENTS = 500; // on the screen; the log has all
  const KEYS = { FORWARD: "F", LEFT: "L", RIGHT: "R", RECALL: "C" };
  const WORDS = { DEAD: "no-command period" }; // of a name that would mislead
  const ENDED = ["SUCCESS", "FAILED", "STOPPED"];
  const STEPS = ["disconnected", "connected", "loaded", "ready", "running"];

  let hello = null, state = null, refused = "", failures = 0, begun = null, playback = null, isCentred = false, isFitted = true;
  const draft = canine.draft(), sound = canine.sound();
  const alarms = canine.alarms({ warnings: id("warnings"), cautions: id("cautions"), calm: id("calm") }, sound);
  const numbers = canine.numbers(id("numbers")), vest = canine.numbers(id("vest"));
  const gauge = canine.gauge(id("gauge")), cue = canine.cue(), age = canine.ages();
  const course = canine.course(id("strip"), id("plots"));
  id("cue").append(cue.element);
  id("theme").replaceWith(canine.themeSwitch());
  const say = (text) => (id("said").textContent = text);
  const places = canine.places(id("places"), id("total"), draft, say);
  const chart = canine.chart(id("map"), draft, [0, 0]);
  canine.background(chart.map.leaflet, { files: id("ground"), crs: id("ground-crs"), opacity: id("ground-opacity"),
    remove: id("ground-remove"), said: id("ground-said") }, () => draft.value.home);

  const routes = canine.routes(chart.map.leaflet, draft, { file: id("buildings"), end: id("end-area"), clear: id("clear-areas"),
    propose: id("propose"), use: id("use-route"), list: id("routes"), said: id("routes-said") }, ask);
  chart.area = routes.addCorner;

  const link = canine.connect({ react, changed });
  // Each message names the state that it answers, by its time: the station lets none act that comes too late.
  const answer = (message) => link.send({ ...message, seen: state && state.time });
  const send = (message) => answer(message) || void tell({ level: "warning", text: `not sent, nobody answers: ${message.do}` });
  const isReplay = () => Boolean(hello && hello.replay);
  const isCommander = () => Boolean(link.isOpen() && hello && state && !isReplay() && state.commander === hello.you);
  const isRunning = () => Boolean(state && state.link === "running");
  const nameOf = (kind, value) => (typeof value === "number" ? hello.enums[kind][value] : value);
  const inWords = (kind, value) =>
    WORDS[nameOf(kind, value)] || (nameOf(kind, value) || "\u2013").toLowerCase().replaceAll("_", " ");
  const isHeard = () => Boolean(state && state.link !== "disconnected");

  // what the server tells

  function changed(open) {
    if (open) [refused, failures] = ["", 0];
    else {
      canine.leave();
      failures += 1;
      if (!hello || failures > 2) askWhy();
    }
    drawSoon();
  }
  // A browser does not say why a socket was not opened: a request tells, if the station refuses this page.
  async function askWhy() {
    const answer = await fetch("/export?to=gpx", { method: "POST", headers: headers() }).catch(() => null);
    refused = answer && answer.status === 403 && !link.isOpen() ? await reasonOf(answer) : "";
    drawSoon();
  }
  const silence = () => (refused ? `the station refuses this page: ${refused}` : "the station does not answer");
  function react(message) {
    if (message.is === "hello") begin(message);
    else if (message.is === "state") take(message);
    else if (message.is === "history") recall(message);
    else if (message.is === "event") tell(message);
    else if (message.is === "error") {
      say(message.text);
      tell({ time: state && state.time, level: "caution", text: message.text });
    }
  }
  function begin(message) {
    const first = hello === null, what = ({ version, source, replay, world }) => JSON.stringify([version, source, replay, world]);
    if (!first && what(hello) !== what(message)) return location.reload(); // another station is at this address now
    hello = message;
    state = null;
    id("source").textContent = id("source").title = hello.source;
    id("signed").hidden = !hello.insecure;
    document.title = hello.source + " \u2013 Guided Canine station";
    document.body.classList.toggle("replay", isReplay());
    const { thresholds, limits } = hello;
    gauge.setThresholds(thresholds);
    course.setThresholds(thresholds);
    course.fixed = isReplay();
    chart.radius = places.radius = thresholds.capture_radius || 0;
    chart.limits = limits;
    link.patience = limits.silent_s;
    if (first && isReplay()) buildPlayback();
    if (first && hello.world) chart.world = hello.world;
    id("world").hidden = !hello.world;
    id("playback").hidden = !isReplay();
    id("scenario").hidden = !hello.scenario;
  }
  // The map begins where the mission is, or else the scenario's, or the animal.
  function centre() {
    const place = draft.value.home || (hello.scenario && hello.scenario.home) || state.place;
    if (isCentred || !place) return;
    isCentred = true;
    chart.map.setPlane(canine.plane(place));
    chart.map.leaflet.setView(place, 19);
    if (draft.value.waypoints.length) chart.map.fit();
  }
  function take(message) {
    const before = state;
    state = message;
    if (state.draft && (before === null || !isCommander())) draft.adopt(state.draft);
    centre();
    chart.homeAtHand = state.place || (hello.scenario && hello.scenario.home);
    const { telemetry } = state;
    if (telemetry) {
      const told = nameOf("command", telemetry.command), heard = isHeard() ? { ...telemetry, command: told } : {};
      const added = !isReplay() && course.add({
        ...heard, time: state.time, latitude: state.place && state.place[0], longitude: state.place && state.place[1],
        mode: nameOf("mode", telemetry.mode) });
      if (added) chart.follow(state.place, told);
      const wasRunning = before && before.link === "running";
      if (!isRunning()) begun = null;
      else if (!wasRunning || begun === null) {
        begun = before ? state.time : sinceStart(state.time);
        if (before) chart.setTrack([]); // that of this trial alone
      }
    }
    if (before === null) takeIfFree();
    if (isReplay() && !isFitted) {
      isFitted = true;
      chart.map.fit();
    }
    drawSoon();
  }
  // The time at which the trial that goes on began, from what was told before.
  function sinceStart(now) {
    const { time, mode } = course.rows, last = mode.lastIndexOf("IDLE");
    return time.length ? time[Math.min(last + 1, time.length - 1)] : now;
  }
  function recall({ columns, events }) {
    const named = { ...columns, command: columns.command.map((value) => nameOf("command", value)),
      mode: columns.mode.map((value) => nameOf("mode", value)) };
    course.take(named);
    chart.setTrack(columns.latitude.map((value, row) => [value, columns.longitude[row]]), named.command);
    id("events").replaceChildren();
    events.forEach(tell);
    isFitted = false;
  }

  function tell({ time, level, text }) {
    const list = id("events");
    list.prepend(canine.element("li", { class: level },
      canine.element("span", { class: "number when" }, canine.isNumber(time) ? canine.clock(time, 1) : ""), " ",
      canine.element("span", { class: "level" }, level), " ", canine.element("span", {}, text)));
    while (list.children.length > MOST_EVENTS) list.lastChild.remove();
  }

  // the command

  // A page that comes takes the command by itself only if nobody has it and no mission is under way; one that
  // has watched asks for it.
  function takeIfFree() {
    if (state.commander === null && !isRunning() && !isReplay() && !document.hidden) send({ do: "take" });
  }
  // A page that nobody sees does not command: Space would not reach it.
  setInterval(() => {
    if (isCommander() && !document.hidden) answer({ do: "alive" });
  }, ALIVE_MS);
  const stop = function () {
    manual.letGo();
    start.letGo();
    send({ do: "stop" });
  };
  id("stop").addEventListener("pointerdown", (event) => {
    if (event.button === 0) stop();
  });
  id("stop").addEventListener("click", (event) => {
    if (event.detail === 0) stop(); // by Enter, or by a screen reader
  });
  const mayMove = () => isRunning() || manual.held !== null || Boolean(state && (state.holding || state.starting));
  for (const type of ["keydown", "keyup"]) {
    window.addEventListener(type, (event) => {
      if (event.code !== "Space" || isReplay()) return;
      if (canine.isText(event.target) && (event.shiftKey || !mayMove())) return; // writes a space
      event.preventDefault();
      event.stopImmediatePropagation();
      if (type === "keydown" && !event.repeat) stop();
    }, { capture: true });
  }
  const start = canine.heldFor(id("start"), "G", HOLD_S, () => send({ do: "start" }));
  const manual = canine.manual([...document.querySelectorAll("#manual button")], KEYS, send);
  const press = (button, act) => id(button).addEventListener("click", act);
  press("abort", () => send({ do: "abort" }));
  press("clear-stop", () => send({ do: "clear_stop" }));
  press("take", () => send({ do: "take" }));
  press("hand-over", () => send({ do: "hand_over" }));

  // the mission

  let draftTimer = null;
  draft.listen((_, mine) => {
    drawSoon();
    if (!mine || draftTimer !== null) return;
    draftTimer = setTimeout(sendDraft, DRAFT_MS);
  });
  function sendDraft() {
    clearTimeout(draftTimer);
    draftTimer = null;
    if (isCommander()) send({ do: "draft", mission: draft.value });
  }
  press("upload", () => {
    sendDraft();
    say("");
    send({ do: "upload" });
  });
  press("undo", () => draft.undo());
  press("redo", () => draft.redo());
  press("clear", () => draft.change({ waypoints: [], fence: [] }));
  press("scenario", () => {
    draft.change(hello.scenario);
    chart.map.fit();
  });
  press("home-here", () => draft.change({ home: state.place }));
  press("add-waypoint", () => chart.add("waypoint", chart.centre()));
  press("add-corner", () => chart.add("fence", chart.centre()));
  press("add-area-corner", () => chart.add("area", chart.centre()));
  press("fit", () => chart.map.fit());
  const follows = () => id("follow").getAttribute("aria-pressed") === "true";
  press("follow", () => id("follow").setAttribute("aria-pressed", String(!follows())));
  const tools = [...document.querySelectorAll("[data-tool]")];
  for (const button of tools) {
    button.addEventListener("click", () => {
      for (const other of tools) other.setAttribute("aria-pressed", String(other === button));
      chart.tool = button.dataset.tool;
    });
  }
  const headers = () => (canine.token() ? { "X-Token": canine.token() } : {});
  // Why the station, or what stands before it, does not do what was asked: JSON of ours, or any text.
  async function reasonOf(answer) {
    const text = await answer.text().catch(() => "");
    try {
      return JSON.parse(text).error;
    } catch {
      return text || `${answer.status} ${answer.statusText}`;
    }
  }
  async function ask(path, body, what) {
    const answer = await fetch(path, { method: "POST", body, headers: headers() });
    if (answer.ok) return answer;
    throw new Error(`${what}: ${await reasonOf(answer)}`);
  }
  id("import").addEventListener("change", async () => {
    const [file] = id("import").files;
    if (!file) return;
    try {
      const mission = await (await ask("/import?name=" + encodeURIComponent(file.name), file, "Import")).json();
      draft.change({ waypoints: mission.waypoints, fence: mission.fence, ...(mission.home ? { home: mission.home } : {}) });
      say([`${file.name}: ${mission.waypoints.length} waypoints`, ...mission.notes].join("; "));
      chart.map.fit();
    } catch (error) {
      say(error.message);
    }
    id("import").value = "";
  });
  id("export").addEventListener("change", async () => {
    const to = id("export").value;
    id("export").value = "";
    if (!to) return;
    try {
      const file = await (await ask("/export?to=" + to, JSON.stringify({ mission: draft.value }), "Export")).blob();
      const address = URL.createObjectURL(file), anchor = canine.element("a", { href: address, download: "mission." + to });
      anchor.click();
      URL.revokeObjectURL(address);
      say("");
    } catch (error) {
      say(error.message);
    }
  });

  // the rest of the page

  id("note-form").addEventListener("submit", (event) => {
    event.preventDefault();
    const text = id("note").value.trim();
    if (text && send({ do: "note", text })) id("note").value = "";
  });
  const mute = function () {
    sound.muted = !sound.muted;
    id("mute").setAttribute("aria-pressed", String(sound.muted));
    id("mute").textContent = sound.muted ? "Muted" : "Mute";
  };
  press("mute", mute);
  press("help", () => id("keys").showModal());
  window.addEventListener("keydown", (event) => {
    if (canine.isText(event.target)) return;
    const key = event.key.toLowerCase();
    if (key === "m" && !event.ctrlKey && !event.metaKey && !event.repeat) mute();
    if (!(event.ctrlKey || event.metaKey) || !isCommander() || (key !== "z" && key !== "y")) return;
    event.preventDefault();
    if (key === "y" || event.shiftKey) draft.redo();
    else draft.undo();
  });
  const tabs = [...document.querySelectorAll("[role=tab]")];
  const select = function (tab) {
    for (const other of tabs) {
      other.setAttribute("aria-selected", String(other === tab));
      other.tabIndex = other === tab ? 0 : -1;
      id(other.getAttribute("aria-controls")).hidden = other !== tab;
    }
  };
  tabs.forEach((tab, index) => {
    tab.addEventListener("click", () => select(tab));
    tab.addEventListener("keydown", ({ key }) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[key];
      if (!step) return;
      const next = tabs[(index + step + tabs.length) % tabs.length];
      select(next);
      next.focus();
    });
  });

  // A timeline whose time is the server's.
  function buildPlayback() {
    const listeners = new Set();
    let asked = null;
    const replay = {
      ...hello.replay, time: hello.replay.from, speed: 1, playing: false,
      listen(react) {
        listeners.add(react);
        react(replay);
      },
      move(time) {
        replay.time = time;
        if (asked === null) {
          asked = setTimeout(() => {
            asked = null;
            send({ do: "seek", time: replay.time });
          }, SEEK_MS);
        }
        listeners.forEach((react) => react(replay));
      },
      play: (speed) => send({ do: "play", speed: speed || replay.speed }),
      pause: () => send({ do: "pause" }),
      show(told) {
        if (!told || asked !== null) return;
        Object.assign(replay, { time: told.time, playing: told.playing });
        listeners.forEach((react) => react(replay));
        course.move(told.time);
      },
    };
    playback = replay;
    id("playback").append(canine.playback(replay));
  }

  // drawing, at most each DRAW_MS

  let drawTimer = null, courseAt = -Infinity;
  function drawSoon() {
    if (drawTimer === null) drawTimer = setTimeout(draw, DRAW_MS);
  }
  setInterval(drawSoon, 1000); // ages grow, alarms sound again
  function draw() {
    drawTimer = null;
    drawDesk();
    drawConduct();
    drawAlarms();
    drawMission();
    if (!state) return;
    drawReadings();
    if (!isReplay() && performance.now() - courseAt > COURSE_MS) {
      courseAt = performance.now();
      course.draw();
    }
    if (playback) playback.show(state.replay);
    document.body.dataset.drawn = state.time; // the state that is seen
  }
  function drawDesk() {
    const step = link.isOpen() && state ? state.link : "disconnected";
    for (const item of id("steps").children) {
      const rank = STEPS.indexOf(item.dataset.step);
      item.classList.toggle("passed", rank < STEPS.indexOf(step) && rank > 0);
      if (item.dataset.step === step) item.setAttribute("aria-current", "step");
      else item.removeAttribute("aria-current");
    }
    let words = silence();
    if (link.isOpen() && isReplay()) words = "replay of a log";
    else if (link.isOpen() && state) {
      const who = state.commander;
      words = who === null ? "nobody commands" : who === hello.you ? "you command" : `operator ${who} commands, you watch`;
      if (state.offered) words += who === hello.you ? "; handed over to who takes it" : "; the command is offered";
    }
    if (id("who").textContent !== words) id("who").textContent = words;
    const watches = link.isOpen() && state && !isReplay();
    const show = (button, isShown) => button.classList.toggle("away", !isShown); // its room is kept: no button moves
    show(id("take"), watches && (state.commander !== hello.you || state.offered));
    id("take").textContent = isCommander() ? "Keep command" : "Take command";
    id("take").disabled = Boolean(watches && state.commander !== null && state.commander !== hello.you && state.commander_alive && !state.offered);
    show(id("hand-over"), isCommander() && state.operators.length > 1 && !state.offered);
  }
  function drawConduct() {
    const mine = isCommander(), latched = Boolean(state && state.stop_latched), heard = isHeard();
    const obeyed = heard && Boolean(state.telemetry) && nameOf("command", state.telemetry.command) === "STOP";
    const reasons = whyNot();
    id("stop").classList.toggle("latched", latched);
    id("stop").setAttribute("aria-pressed", String(latched));
    const [title, hint] = id("stop").children;
    title.textContent = !latched ? "STOP" : obeyed ? "STOPPED" : "STOP ordered";
    if (!latched) hint.textContent = "Space";
    else if (obeyed) hint.textContent = "STOP holds until it is cleared";
    else hint.textContent = heard ? "the vest does not tell yet that it obeys" : "the vest does not hear it";
    id("stop").disabled = isReplay();
    id("clear-stop").hidden = !latched;
    id("clear-stop").disabled = !mine;
    id("start").disabled = !mine || reasons.length > 0 || state.link !== "ready" || !isUploaded();
    id("abort").disabled = !mine || !heard;
    if (id("start").disabled) start.letGo();
    if (!mine || !heard) manual.letGo(); // a button that is off hears no release
    for (const button of document.querySelectorAll("#manual button")) {
      button.disabled = !mine || !heard;
      button.classList.toggle("active", Boolean(state && state.holding === button.dataset.command));
    }
    const items = reasons.map((reason) => canine.element("li", {}, reason)), shown = id("why");
    let head = "A mission is under way. ";
    if (!isRunning()) head = reasons.length ? "Not ready to start: " : state.starting ? "START was sent" : "Ready for START";
    const text = outcome() + head + reasons.join();
    if (shown.dataset.text === text) return;
    shown.dataset.text = text;
    shown.replaceChildren(...[outcome(), head].filter(Boolean).map((words) => canine.element("p", {}, words)),
      canine.element("ul", {}, ...items));
  }
  // How the last trial ended, until an ABORT clears it.
  function outcome() {
    const status = state && state.telemetry && nameOf("status", state.telemetry.status);
    return ENDED.includes(status) ? `The trial has ended: ${inWords("status", status)}. ABORT makes the vest ready for another. ` : "";
  }
  // Why START cannot be given now, in words.
  function whyNot() {
    if (isReplay()) return ["this is a log"];
    if (!link.isOpen() || !state) return [silence()];
    if (isRunning()) return [];
    const reasons = state.missing.map(({ words }) => words);
    if (state.refusal) reasons.push("the last START was refused: " + state.refusal);
    return reasons;
  }
  const isUploaded = () =>
    Boolean(state && state.on_board && (state.on_board.mission ? canine.sameMission(state.on_board.mission, draft.value) : state.on_board.id === state.draft_id));

  function drawAlarms() {
    const told = state && link.isOpen() ? state.alarms : [];
    const own = link.isOpen() || !(hello || refused) ? [] : [{ key: "station", level: "warning", since: null,
      text: silence() + (hello ? ": nothing can be sent, not even STOP; the vest stops by itself when it hears nobody" : "") }];
    alarms.show([...own, ...told], state && state.time);
  }
  function drawMission() {
    const mine = isCommander();
    chart.mayEdit = places.mayEdit = routes.mayEdit = mine;
    id("undo").disabled = !mine || !draft.canUndo;
    id("redo").disabled = !mine || !draft.canRedo;
    for (const button of ["add-waypoint", "add-corner", "add-area-corner", "clear", "scenario", "import"]) id(button).disabled = !mine;
    for (const button of tools) button.disabled = !mine && button.dataset.tool !== "move";
    id("home-here").disabled = !mine || !state.place;
    const { home, waypoints } = draft.value, board = state && state.on_board;
    id("export").disabled = waypoints.length === 0;
    id("upload").disabled = !mine || !home || waypoints.length === 0 || state.link === "disconnected" || isRunning() || isUploaded();
    chart.onBoard = (board && board.mission) || null;
    let words = "No mission is on board";
    if (state && state.uploading) words = "Uploading ...";
    else if (board) {
      const shown = isUploaded() ? "on screen is what is on board" : board.mission ? "on board differs from the screen" : "on board was given by another, and is not known here";
      words = `Mission ${board.id.toString(16).padStart(4, "0")}: ${shown}`;
    }
    if (waypoints.length && !home) words += "; home is not marked yet";
    if (board && isRunning() && !isUploaded()) words += "; the mission under way is that on board: ABORT it to upload another";
    if (id("on-board").textContent !== words) id("on-board").textContent = words;
  }
  function drawReadings() {
    const { telemetry, place } = state, heard = telemetry && isHeard();
    const quality = state.link_quality || {}; // a trial's log has none
    const told = telemetry ? nameOf("command", telemetry.command) : "NONE", shown = telemetry || {};
    cue.set(told, hello.cues[told]);
    gauge.set(telemetry && isRunning() ? telemetry.deviation : null);
    const mission = state.on_board && state.on_board.mission, total = mission ? mission.waypoints.length : null;
    const aim = mission && isRunning() ? mission.waypoints[shown.waypoint] || mission.home : null;
    chart.show(place, shown.heading, shown.position_sd, aim);
    if (follows() && (isRunning() || isReplay())) chart.keep(place);
    const gps = age("gps", shown.gps_frames, state.time), imu = age("imu", shown.imu_frames, state.time);
    const stale = (seconds) => (!heard ? "stale" : seconds > 2 ? "warning" : seconds > 1 ? "caution" : "");
    const format = canine.format, dim = heard ? "" : "stale", count = (number) => String(number ?? "\u2013");
    numbers.set({
      "Speed": [format(shown.speed, "m/s", 1), dim],
      "Heading": [canine.compass(shown.heading), dim],
      "To target": [isRunning() ? format(shown.distance, "m", 1) : "\u2013", dim],
      "Reached": [telemetry ? `${shown.waypoint}${total === null ? "" : " of " + total}` : "\u2013", dim],
      "Mode": [inWords("mode", shown.mode), dim],
      "Trial": [begun === null ? "\u2013" : canine.clock(state.time - begun, 0), dim],
      "Place 2-sigma": [format(2 * shown.position_sd, "m", 1), dim],
      "GPS age": [telemetry ? format(gps, "s", 1) : "\u2013", stale(gps)],
      "IMU": [telemetry ? (imu > 1 ? `silent ${format(imu, "s", 0)}` : "ok") : "\u2013", stale(imu)],
      "Turns in all": [count(shown.directional_commands), dim],
      "Turn budget": [canine.leftOf.issues(shown.issues_left), dim],
      "Link age": [format(quality.age_s, "s", 1), stale(quality.age_s)],
    });
    vest.set({
      "Status": inWords("status", shown.status),
      "Anomaly": inWords("anomaly", shown.anomaly),
      "Last anomaly": inWords("anomaly", shown.last_anomaly),
      "MAXTURN": canine.mostTurns(hello.thresholds),
      "Vibration budget": canine.leftOf.seconds(shown.vibration_left),
      "Tone budget": canine.leftOf.seconds(shown.tone_left),
      "Battery": canine.battery(shown.battery),
      "Temperature": canine.temperature(shown.temperature),
      "GPS errors": count(shown.gps_errors),
      "IMU errors": count(shown.imu_errors),
      "Fixes rejected": count(shown.rejected_fixes),
      "Round trip": format(quality.round_trip_s, "s", 2),
      "Frames lost": count(quality.lost),
      "Frames late": count(quality.late),
      "Frames damaged": count(quality.errors),
      "Frames forged": count(quality.forged),
      "Sessions": count(quality.sessions),
      "Vest: damaged": count(shown.link_errors),
      "Vest: forged": count(shown.link_forged),
      "Vest: replayed": count(shown.link_replayed),
      "Radio": hello.insecure ? ["not signed", "caution"] : "signed",
    });
  }
  draw();
})();
