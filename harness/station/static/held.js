// Buttons and keys that act only while they are held.
(function () {
  "use strict";
  const canine = (window.canine = window.canine || {});
  const AGAIN_MS = 100; // between two messages of a hold

  const isText = (element) =>
    element instanceof HTMLElement &&
    (element.isContentEditable || element.tagName === "TEXTAREA" || (element.tagName === "INPUT" && /^(text|number|search)$/.test(element.type)));
  canine.isText = isText;

  // A button, and a key of the whole page: `begin()` when it is pressed (false refuses), `end()` when it is let go.
  canine.held = function (button, key, { begin, end }) {
    let pointer = null, pressed = null; // the pointer and the key that hold it
    const isHeld = () => pointer !== null || pressed !== null;
    const start = function () {
      if (button.disabled || begin() === false) return false;
      button.classList.add("held");
      return true;
    };
    const letGo = function () {
      if (!isHeld()) return;
      pointer = pressed = null;
      button.classList.remove("held");
      end();
    };
    button.addEventListener("pointerdown", (event) => {
      if (event.button !== 0 || isHeld() || !start()) return;
      pointer = event.pointerId;
      button.setPointerCapture(pointer);
    });
    for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
      button.addEventListener(name, (event) => {
        if (event.pointerId === pointer) letGo();
      });
    }
    button.addEventListener("contextmenu", (event) => event.preventDefault());
    window.addEventListener("keydown", (event) => {
      const global = event.code === "Key" + key && !isText(event.target) && !event.ctrlKey && !event.metaKey && !event.altKey;
      const local = event.key === "Enter" && event.target === button;
      if (!global && !local) return;
      event.preventDefault();
      if (!event.repeat && !isHeld() && start()) pressed = event.code;
    });
    window.addEventListener("keyup", (event) => {
      if (pressed !== null && event.code === pressed) letGo();
    });
    canine.onLeave(letGo);
    return { letGo };
  };

  // Calls back whenever the operator's eyes or hands have left the page.
  const leavers = new Set();
  canine.onLeave = (react) => leavers.add(react);
  const leave = () => leavers.forEach((react) => react());
  window.addEventListener("blur", leave);
  window.addEventListener("pagehide", leave);
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) leave();
  });
  canine.leave = leave;

  // A button that acts after it was held for so many seconds; its `.progress` shows how long.
  canine.heldFor = function (button, key, seconds, act) {
    let timer = null;
    const bar = button.querySelector(".progress");
    const hold = canine.held(button, key, {
      begin() {
        bar.style.transition = `width ${seconds}s linear`;
        bar.style.width = "100%";
        timer = setTimeout(() => {
          hold.letGo();
          act();
        }, 1000 * seconds);
      },
      end() {
        clearTimeout(timer);
        bar.style.transition = "none";
        bar.style.width = "0";
      },
    });
    return hold;
  };

  // Buttons with `data-command`: the command is sent again and again while its button is held, then released.
  canine.manual = function (buttons, keys, send) {
    let timer = null, held = null;
    const holds = buttons.map((button) => {
      const command = button.dataset.command;
      return canine.held(button, keys[command], {
        begin() {
          if (held !== null) return false; // one at a time
          held = command;
          send({ do: "hold", command });
          timer = setInterval(() => send({ do: "hold", command }), AGAIN_MS);
          return true;
        },
        end() {
          clearInterval(timer);
          held = null;
          send({ do: "release" });
        },
      });
    });
    return { letGo: () => holds.forEach((one) => one.letGo()), get held() { return held; } };
  };
})();
