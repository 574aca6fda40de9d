"use strict";

// The joints' angles under the time axis, with the limits that are near; a click on a joint's name shows it between its own.
class Joints {
  static hues = ["#4a63dd", "#d9663f", "#2f9e6e", "#c04f8e", "#b28a1e", "#2c93b5", "#7a7f8a", "#8458c9"];
  static near = 0.05; // of its range

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

  // "panda_joint1" is joint1 and "wrist_1_joint" is wrist 1 where the others are called alike.
  static short(names) {
    const first = names[0].split("_")[0];
    const prefix = names.length > 1 && names.every((name) => name.startsWith(`${first}_`)) ? first.length + 1 : 0;
    return names.map((name) => name.slice(prefix).replace(/_joint$/, "").replaceAll("_", " "));
  }

  chip(name, j) {
    const { names, lower, upper } = this.joints;
    const limits = Number.isFinite(upper[j] - lower[j]) ? `${degrees(lower[j], 0)} to ${degrees(upper[j], 0)}` : "no limits";
    const chip = make("button", "", { title: `${name}: ${limits}`, onclick: () => this.choose(j) });
    chip.style.setProperty("--hue", Joints.hues[j % Joints.hues.length]);
    chip.append(make("span", Joints.short(names)[j]), make("b"));
    return chip;
  }

  choose(j) {
    this.chosen = this.chosen === j ? null : j;
    this.plot();
  }

  curve(j) {
    const n = this.joints.t.length;
    return this.joints.q.subarray(j * n, (j + 1) * n);
  }

  plot() {
    const { names, t, q, lower, upper } = this.joints;
    const shown = this.chosen === null ? [...q] : [...this.curve(this.chosen), lower[this.chosen], upper[this.chosen]];
    const finite = shown.filter(Number.isFinite);
    const low = Math.min(...finite);
    const high = Math.max(...finite, low + 1e-3);
    const x = (time) => (1000 * time) / (this.duration || 1);
    const y = (angle) => 1000 * (1 - (angle - low) / (high - low));
    const across = (height, properties) => draw("line", { x1: 0, x2: 1000, y1: height, y2: height, ...properties });
    const marks = this.keyframes.map((time) => draw("line", { x1: x(time), x2: x(time), y1: -30, y2: 1030 }));
    const limits = [];
    const curves = names.map((_, j) => {
      const look = { stroke: Joints.hues[j % Joints.hues.length], class: this.chosen === null || this.chosen === j ? "" : "faint" };
      const inside = [lower[j], upper[j]].filter((limit) => low <= limit && limit <= high);
      limits.push(...inside.map((limit) => across(y(limit), { ...look, class: `limit ${look.class}` })));
      const points = Array.from(this.curve(j), (angle, i) => `${x(t[i]).toFixed(1)},${y(angle).toFixed(1)}`);
      return draw("polyline", { points: points.join(" "), ...look });
    });
    this.cursor = draw("line", { class: "now", y1: -30, y2: 1030 });
    element("plot").replaceChildren(...marks, ...limits, ...curves, this.cursor);
    element("highest").textContent = degrees(high, 0);
    element("lowest").textContent = degrees(low, 0);
    this.chips.forEach((chip, j) => chip.setAttribute("aria-pressed", j === this.chosen));
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
      chip.lastChild.textContent = degrees(angle);
      chip.classList.toggle("near", Math.min(angle - lower[j], upper[j] - angle) < Joints.near * (upper[j] - lower[j]));
    });
  }
}
