"use strict";

// The joints' angles, or metres of sliding joints, under the time axis, each scaled to its own limits. A click on a
// joint's name fades the others.
class Joints {
  static hues = ["#4a63dd", "#d9663f", "#2f9e6e", "#c04f8e", "#b28a1e", "#2c93b5", "#7a7f8a", "#8458c9"];
  static nearLimit = 0.05; // share of its range: an angle closer to a limit is highlighted

  constructor({ joints, keyframes, duration }, seek) {
    Object.assign(this, { joints, duration });
    this.keyframes = keyframes.map((k) => k.t);
    this.chosen = null;
    this.chips = joints.names.map((name, j) => this.chip(name, j));
    element("angles").replaceChildren(...this.chips);
    const svg = element("plot");
    const point = (event) => {
      const box = svg.getBoundingClientRect();
      if (event.buttons & 1) seek(((event.clientX - box.left) / box.width) * duration);
    };
    svg.onpointerdown = (event) => { svg.setPointerCapture(event.pointerId); point(event); };
    svg.onpointermove = point;
    this.plot();
  }

  static hue(j) {
    return Joints.hues[j % Joints.hues.length];
  }

  // Short names: "panda_joint1" becomes "joint1" if all names share the prefix; "wrist_1_joint" becomes "wrist 1".
  static short(names) {
    const first = names[0].split("_")[0];
    const prefix = names.length > 1 && names.every((name) => name.startsWith(`${first}_`)) ? first.length + 1 : 0;
    return names.map((name) => name.slice(prefix).replace(/_joint$/, "").replaceAll("_", " "));
  }

  chip(name, j) {
    const { names, lower, upper } = this.joints;
    const limits = this.limited(j) ? `${this.text(j, lower[j], 0)} to ${this.text(j, upper[j], 0)}` : "no limits";
    const chip = make("button", "", { title: `${name}: ${limits}`, onclick: () => this.choose(j) });
    chip.style.setProperty("--hue", Joints.hue(j));
    chip.append(make("span", Joints.short(names)[j]), make("b"));
    return chip;
  }

  text(j, value, places) {
    return this.joints.slides[j] ? `${digits(value, places + 2)} m` : degrees(value, places);
  }

  choose(j) {
    this.chosen = this.chosen === j ? null : j;
    this.plot();
  }

  curve(j) {
    const n = this.joints.t.length;
    return this.joints.q.subarray(j * n, (j + 1) * n);
  }

  limited(j) {
    return Number.isFinite(this.joints.upper[j] - this.joints.lower[j]);
  }

  // Angles at the bottom and at the top of the plot: the joint's limits, or half a turn to either side without limits.
  range(j) {
    if (this.limited(j)) return [this.joints.lower[j], this.joints.upper[j]];
    const [low, high] = [Math.min(...this.curve(j)), Math.max(...this.curve(j))];
    const half = Math.max(Math.PI, (high - low) / 2);
    return [(low + high) / 2 - half, (low + high) / 2 + half];
  }

  plot() {
    const { names, t } = this.joints;
    const { chosen } = this;
    const x = (time) => (1000 * time) / (this.duration || 1);
    const marks = this.keyframes.map((time) => draw("line", { x1: x(time), x2: x(time), y1: -30, y2: 1030 }));
    const look = { class: "limit", ...(chosen !== null && { stroke: Joints.hue(chosen) }) };
    const ends = chosen === null || this.limited(chosen) ? [0, 1000] : [];
    const limits = ends.map((height) => draw("line", { x1: 0, x2: 1000, y1: height, y2: height, ...look }));
    const curves = names.map((_, j) => {
      const [low, high] = this.range(j);
      const points = Array.from(this.curve(j), (angle, i) => `${x(t[i]).toFixed(1)},${((1000 * (high - angle)) / (high - low || 1)).toFixed(1)}`);
      const faint = chosen === null || chosen === j ? "" : "faint";
      return draw("polyline", { points: points.join(" "), stroke: Joints.hue(j), class: `${faint} ${this.limited(j) ? "" : "free"}` });
    });
    this.cursor = draw("line", { class: "now", y1: -30, y2: 1030 });
    element("plot").replaceChildren(...marks, ...limits, ...curves, this.cursor);
    const [lowest, highest] = chosen === null ? ["limit", "limit"] : this.range(chosen).map((end) => this.text(chosen, end, 0));
    element("highest").textContent = highest;
    element("lowest").textContent = lowest;
    this.chips.forEach((chip, j) => chip.setAttribute("aria-pressed", j === chosen));
    this.show(this.time ?? 0);
  }

  angle(j) {
    const { t } = this.joints;
    const curve = this.curve(j);
    const at = (this.time / (t[t.length - 1] || 1)) * (t.length - 1);
    const i = Math.min(Math.floor(at), t.length - 1);
    const next = Math.min(i + 1, t.length - 1);
    return curve[i] + Math.min(at - i, 1) * (curve[next] - curve[i]);
  }

  show(time) {
    this.time = time;
    const { lower, upper } = this.joints;
    for (const end of ["x1", "x2"]) this.cursor.setAttribute(end, (1000 * time) / (this.duration || 1));
    this.chips.forEach((chip, j) => {
      const angle = this.angle(j);
      chip.lastChild.textContent = this.text(j, angle, 1);
      chip.classList.toggle("near", Math.min(angle - lower[j], upper[j] - angle) < Joints.nearLimit * (upper[j] - lower[j]));
    });
  }
}
