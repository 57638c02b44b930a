// The page of a trial while it runs: it asks for the rows that it lacks, and at the end for the page of the trial.
(function () {
  "use strict";
  const of = (id) => document.getElementById(id);
  const address = new URL("/ws", location.href);
  address.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  const socket = new WebSocket(address, ["canine"]);
  let page = null, ticks = 0, signals = 0, waits = false, isOver = false;

  function ask() {
    waits = true;
    socket.send(JSON.stringify({ do: "rows", ticks, signals }));
  }
  // The table of events, as text.
  function tell(events) {
    of("events").tBodies[0].replaceChildren(...events.map(({ time, level, text }) => canine.element("tr", {},
      canine.element("td", {}, canine.element("button", { type: "button", class: "at" }, canine.clock(time))),
      canine.element("td", { class: level }, text))));
  }
  const react = {
    hello: ({ title }) => (of("title").textContent = document.title = title),
    state({ ticks: there }) {
      if (there > ticks && !waits) ask();
    },
    rows({ data, happened }) {
      waits = false;
      tell(happened);
      ticks = data.from + data.time.length;
      signals = Object.keys(data.signals).length;
      if (data.thinned) ticks = data.thinned.ticks;
      if (page) page.update(data);
      else {
        page = canine.answer(data);
        page.timeline.move(Infinity); // the end, where the cursor then stays
      }
      of("status").textContent = `The trial runs: ${canine.clock(data.time[data.time.length - 1])}`;
    },
    error: ({ text }) => (of("status").textContent = text),
    end() {
      isOver = true;
      location.reload();
    },
  };
  socket.addEventListener("message", ({ data }) => {
    const message = JSON.parse(data);
    if (react[message.is]) react[message.is](message);
  });
  socket.addEventListener("close", () => {
    if (!isOver) of("status").textContent = "The trial was ended, or its connection was lost; the log up to there is kept.";
  });
})();
