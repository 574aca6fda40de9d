"use strict";

// The keyboard, with the keys of video players, and the dialog that lists them. `rows` are [words, {key: action, ...}].
class Keys {
  static names = { " ": "Space", ArrowLeft: "←", ArrowRight: "→", ArrowUp: "↑", ArrowDown: "↓" };

  constructor(rows) {
    this.actions = Object.assign({}, ...rows.map(([, actions]) => actions));
    element("keys").replaceChildren(...rows.flatMap(([words, actions]) => [this.caps(Object.keys(actions)), make("dd", words)]));
    const help = element("help");
    help.onclick = (event) => { if (event.target === help) help.close(); };
    document.onkeydown = (event) => this.press(event);
    // A mouse leaves the focus where it was: after a click on a button the space bar still plays.
    document.onmousedown = (event) => { if (event.target.closest("button")) event.preventDefault(); };
  }

  caps(keys) {
    const caps = make("dt");
    const shown = keys.length > 4 ? [keys[0], "–", keys.at(-1)] : keys;
    caps.append(...shown.map((key) => make(key === "–" ? "span" : "kbd", Keys.names[key] ?? (key.length === 1 ? key.toUpperCase() : key))));
    return caps;
  }

  help() {
    const help = element("help");
    if (help.open) help.close();
    else help.showModal();
  }

  press(event) {
    const action = this.actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    const taken = event.target.tagName === "SELECT" || (event.key === " " && event.target.matches("button, input:not(#seek)"));
    if (!action || taken || event.ctrlKey || event.metaKey || event.altKey) return;
    if (element("help").open && event.key !== "?") return;
    event.preventDefault();
    action();
  }
}
