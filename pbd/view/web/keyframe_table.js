"use strict";

// The table of keyframes, and their numbers in the scene. A click on one sets the time to that keyframe.
class KeyframeTable {
  // Columns that only some tables have, and how they are written.
  static more = { off: (rad) => digits((180 / Math.PI) * Math.max(...rad), 1), inside: (share) => digits(100 * share, 0) };

  constructor(keyframes, go) {
    this.keyframes = keyframes;
    this.more = Object.keys(KeyframeTable.more).filter((name) => keyframes.some((k) => k[name] !== null));
    for (const name of Object.keys(KeyframeTable.more)) element(name).hidden = !this.more.includes(name);
    element("keyframes").classList.toggle("crowded", this.more.length > 0);
    this.labels = keyframes.map((k, i) => make("button", "", { title: this.title(i), tabIndex: -1, dir: "auto", onclick: () => go(k.t), className: this.doubt(i) && "doubted" }));
    this.rows = keyframes.map((k, i) => this.row(k, i, () => go(k.t)));
    element("labels").replaceChildren(...this.labels);
    element("keyframes").tBodies[0].replaceChildren(...this.rows);
    element("keyframes").parentElement.hidden = this.rows.length === 0;
    this.show(-1);
  }

  // The label of keyframe i; without one, what happens at it.
  name(i) {
    const { label, grip } = this.keyframes[i];
    if (label) return label;
    if (grip !== null) return grip ? "close" : "open";
    if (i === 0) return "start";
    return i === this.keyframes.length - 1 ? "end" : "";
  }

  title(i) {
    return `keyframe ${i}${this.name(i) && `: ${this.name(i)}`}${this.doubt(i)}`;
  }

  // A remark where the tracker doubts that the hand stood still.
  doubt(i) {
    const { sure } = this.keyframes[i];
    return sure === null ? "" : `, which may not be a stop (${digits(100 * sure, 0)} % sure)`;
  }

  number(i) {
    return `${i}${this.doubt(i) && "?"}`;
  }

  row(k, i, go) {
    const row = make("tr", "", { onclick: go });
    const number = make("td");
    number.append(make("button", this.number(i), { ariaLabel: `Go to ${this.title(i)}`, title: this.title(i), className: this.doubt(i) && "doubted" }));
    const name = make("td", this.name(i), { title: this.name(i), dir: "auto" });
    if (k.label && k.grip !== null) name.prepend(make("span", k.grip ? "▸◂ " : "◂▸ ", { className: "grip", title: k.grip ? "gripper closes" : "gripper opens" }));
    if (k.detour) name.prepend(make("span", "↷ ", { className: "detour", title: "the arm takes a detour to this keyframe, around an obstacle" }));
    const place = k.p.map((metres) => make("td", digits(100 * metres, 1)));
    const [metres, radians] = k.sigma ?? [];
    const sigma = k.sigma ? [digits(1000 * metres, 1), digits((180 / Math.PI) * radians, 1)] : ["", ""];
    row.append(number, name, make("td", digits(k.t, 2)), ...place, ...sigma.map((text) => make("td", text)));
    row.append(...this.more.map((name) => make("td", k[name] === null ? "" : KeyframeTable.more[name](k[name]))));
    return row;
  }

  // Scrolls the list alone: in a small window, where all of the panel scrolls, the panel stays where its reader is.
  follow({ offsetTop, offsetHeight }) {
    const list = element("list");
    const lowest = offsetTop + offsetHeight - list.clientHeight;
    list.scrollTop = Math.min(Math.max(list.scrollTop, lowest), offsetTop - element("keyframes").tHead.offsetHeight);
  }

  // `current`: the keyframe that was reached last; -1 before the first.
  show(current) {
    if (current === this.current) return;
    this.current = current;
    this.rows.forEach((row, i) => row.setAttribute("aria-current", i === current));
    this.labels.forEach((label, i) => {
      label.classList.toggle("now", i === current);
      label.textContent = `${this.number(i)} ${i === current ? this.keyframes[i].label : ""}`.trim();
    });
    if (current >= 0) this.follow(this.rows[current]);
  }
}
