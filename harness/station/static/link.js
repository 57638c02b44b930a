// The socket to the station: it opens again when it was lost, and tells when nobody answers.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const SILENT_S = 3; // until the station has told how long it may say nothing
  const LOOK_MS = 500;
  const SHORTEST_MS = 500, LONGEST_MS = 4000; // before another attempt

  canine.token = () => new URLSearchParams(location.hash.slice(1)).get("token");

  // `react(message)`, `changed(isOpen)`; gives {send, isOpen}.
  canine.connect = function ({ react, changed }) {
    let socket = null, heard = 0, wait = SHORTEST_MS, patience = SILENT_S;
    const isOpen = () => socket !== null && socket.readyState === WebSocket.OPEN;

    function open() {
      const token = canine.token(), address = location.protocol.replace("http", "ws") + "//" + location.host + "/ws";
      const mine = new WebSocket(address, token ? ["canine", "token." + token] : ["canine"]);
      socket = mine;
      heard = performance.now();
      mine.addEventListener("open", () => {
        if (mine === socket) changed(true);
      });
      mine.addEventListener("message", ({ data }) => {
        if (mine !== socket) return;
        heard = performance.now();
        wait = SHORTEST_MS;
        react(JSON.parse(data));
      });
      mine.addEventListener("close", () => lost(mine));
    }
    function lost(which) {
      if (which !== socket) return;
      socket = null;
      changed(false);
      setTimeout(open, wait);
      wait = Math.min(2 * wait, LONGEST_MS);
    }
    setInterval(() => {
      if (socket === null || performance.now() - heard < 1000 * patience) return;
      const silent = socket;
      lost(silent);
      silent.close();
    }, LOOK_MS);
    open();
    return {
      isOpen,
      // How long the station may say nothing, in s, once it has told.
      set patience(seconds) { patience = seconds; },
      // False if nobody is there to hear it.
      send(message) {
        if (!isOpen()) return false;
        socket.send(JSON.stringify(message));
        return true;
      },
    };
  };
})();
