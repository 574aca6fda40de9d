"use strict";

// Wires the page: what the scene's description says goes into the panel and the bar, what people do goes to the player.
const element = (id) => document.getElementById(id);
const HUES = ["#4a63dd", "#d9663f", "#2f9e6e", "#c04f8e", "#b28a1e", "#2c93b5", "#7a7f8a", "#8458c9"];

// From when to when the gripper is not at its widest.
function closings({ t, opening }, duration) {
  const spans = [];
  const open = Math.max(...opening, 0) - 0.02;
  for (let i = 0; i < t.length; i++) {
    const until = i + 1 < t.length ? t[i + 1] : duration;
    if (Math.max(opening[i], opening[i + 1] ?? opening[i]) >= open) continue;
    if (spans.length && spans.at(-1)[1] === t[i]) spans.at(-1)[1] = until;
    else spans.push([t[i], until]);
  }
  return spans;
}

// "panda_joint1" is joint1 and "wrist_1_joint" is wrist 1 where the others are called alike.
function shortened(names) {
  const first = names[0] ?? "";
  const prefix = names.length > 1 && names.every((name) => name.startsWith(first.split("_")[0] + "_")) ? first.indexOf("_") + 1 : 0;
  return names.map((name) => name.slice(prefix).replace(/_joint$/, "").replaceAll("_", " "));
}

class Page {
  constructor(stage, replay) {
    this.stage = stage;
    this.replay = replay;
    this.player = new Player(replay.duration, replay.keyframes.map((k) => k.t), () => this.show());
    this.describe();
    this.fillKeyframes();
    this.fillJoints();
    this.fillLegend();
    this.fillTimeline();
    this.listen();
    for (const id of ["panel", "bar"]) element(id).hidden = false;
    document.body.classList.toggle("folded", window.innerWidth <= 640);
    stage.start();
    stage.frame(replay.extent);
    stage.furnish(replay.table);
    stage.label(this.labels, replay.keyframes.map((k) => k.p));
    this.player.seek(0);
  }

  show() {
    const { player, stage } = this;
    stage.show(player.time);
    document.body.classList.toggle("playing", player.playing);
    element("time").replaceChildren(Object.assign(document.createElement("b"), { textContent: player.time.toFixed(2) }), ` / ${player.duration.toFixed(2)} s`);
    element("seek").value = player.time;
    element("timeline").style.setProperty("--done", `${(100 * player.time) / (player.duration || 1)}%`);
    element("speed").value = player.speed;
    element("loop").setAttribute("aria-pressed", player.loop);
    this.showKeyframe();
    this.showJoints();
  }

  // --- panel ---

  describe() {
    const { title, robot, duration, notes } = this.replay;
    document.title = title;
    element("title").textContent = title;
    element("subtitle").textContent = `${robot} · ${duration.toFixed(1)} s`;
    element("notes").replaceChildren(...notes.map((note) => this.make("li", note)));
    element("notes").hidden = notes.length === 0;
  }

  make(tag, text = "", properties = {}) {
    return Object.assign(document.createElement(tag), { textContent: text }, properties);
  }

  fillKeyframes() {
    const go = (k) => () => this.player.seek(k.t);
    this.labels = this.replay.keyframes.map((k, i) => this.make("button", String(i), { title: k.label, onclick: go(k), tabIndex: -1 }));
    element("labels").replaceChildren(...this.labels);
    this.rows = this.replay.keyframes.map((k, i) => {
      const row = this.make("tr", "", { onclick: go(k), tabIndex: 0 });
      row.onkeydown = (event) => { if (event.key === "Enter") go(k)(); };
      const name = this.make("td", k.label || (k.grip === null ? "" : k.grip ? "close" : "open"), { title: k.label });
      if (k.label && k.grip !== null) name.append(this.make("span", k.grip ? " ▸◂" : " ◂▸", { className: "grip", title: k.grip ? "gripper closes" : "gripper opens" }));
      const place = this.make("td");
      place.append(...k.p.map((metres) => this.make("i", (100 * metres).toFixed(1).replace("-", "\u2212"))));
      const sigma = k.sigma === null ? "" : (1000 * Math.max(...k.sigma)).toFixed(1);
      row.append(this.make("td", String(i)), name, this.make("td", k.t.toFixed(2)), place, this.make("td", sigma));
      return row;
    });
    element("keyframes").tBodies[0].replaceChildren(...this.rows);
    element("keyframes").parentElement.hidden = this.rows.length === 0;
  }

  showKeyframe() {
    const before = this.replay.keyframes.filter((k) => k.t <= this.player.time + 1e-3).length - 1;
    if (before === this.current) return;
    this.current = before;
    this.rows[before]?.scrollIntoView({ block: "nearest" });
    this.rows.forEach((row, i) => row.classList.toggle("now", i === before));
    this.labels.forEach((label, i) => label.classList.toggle("now", i === before));
  }

  fillJoints() {
    const { names, t, q } = this.replay.joints;
    const low = Math.min(...q);
    const high = Math.max(...q, low + 1e-6);
    const svg = element("joints").querySelector("svg");
    const draw = (tag, attributes) => {
      const node = document.createElementNS("http://www.w3.org/2000/svg", tag);
      for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
      return node;
    };
    const y = (angle) => 1000 * (1 - (angle - low) / (high - low));
    const x = (time) => (1000 * time) / (this.replay.duration || 1);
    const curves = names.map((_, j) => {
      const points = Array.from(t, (time, i) => `${x(time).toFixed(1)},${y(q[j * t.length + i]).toFixed(1)}`);
      return draw("polyline", { points: points.join(" "), stroke: HUES[j % HUES.length] });
    });
    const marks = this.replay.keyframes.map((k) => draw("line", { x1: x(k.t), x2: x(k.t), y1: 0, y2: 1000 }));
    this.cursor = draw("line", { class: "now", y1: 0, y2: 1000 });
    svg.replaceChildren(...marks, ...curves, this.cursor);
    const seek = (event) => {
      const box = svg.getBoundingClientRect();
      if (event.buttons & 1) this.player.seek(((event.clientX - box.left) / box.width) * this.replay.duration);
    };
    svg.onpointerdown = (event) => { svg.setPointerCapture(event.pointerId); seek(event); };
    svg.onpointermove = seek;
    const short = shortened(names);
    this.angles = names.map((name, j) => {
      const item = this.make("li");
      item.style.setProperty("--hue", HUES[j % HUES.length]);
      item.append(this.make("span", short[j], { title: name }), this.make("b"));
      return item;
    });
    element("joints").querySelector("ul").replaceChildren(...this.angles);
  }

  showJoints() {
    const { t, q } = this.replay.joints;
    const at = (1000 * this.player.time) / (this.replay.duration || 1);
    this.cursor.setAttribute("x1", at);
    this.cursor.setAttribute("x2", at);
    const i = Math.min(Math.round((this.player.time / (t[t.length - 1] || 1)) * (t.length - 1)), t.length - 1);
    this.angles.forEach((item, j) => { item.lastChild.textContent = `${((180 / Math.PI) * q[j * t.length + i]).toFixed(1).replace("-", "\u2212")}°`; });
  }

  // What can be switched off, and what its colours mean.
  fillLegend() {
    const { speed, keyframes } = this.replay;
    const rows = [
      ["hand_path", speed === null ? "hand" : `hand, 0 – ${speed.toFixed(2)} m/s`, "linear-gradient(90deg, #4a6bed, #995cd9, #ed667a, #faa845)"],
      ["tool_path", "robot's tool", "#8c9199"],
      ["keyframes", "keyframes", "linear-gradient(90deg, #e04540 33%, #38a85c 33% 66%, #3875eb 66%)"],
    ];
    if (keyframes.some((k) => k.sigma !== null)) rows.push(["two_sigma", "uncertainty, 2 σ", "rgb(74 107 237 / 0.35)"]);
    element("legend").replaceChildren(...rows.map(([name, text, look]) => {
      const box = this.make("input", "", { type: "checkbox", checked: true, onchange: () => this.reveal(name, box.checked) });
      box.style.setProperty("--look", look);
      const row = this.make("label");
      row.append(box, this.make("span", text));
      return row;
    }));
  }

  reveal(name, visible) {
    if (name === "two_sigma") {
      this.replay.keyframes.forEach((_, i) => { this.stage.node("pbd", "keyframes", String(i), name).visible = visible; });
    } else {
      this.stage.node("pbd", name).visible = visible;
    }
    if (name === "keyframes") element("labels").hidden = !visible;
    this.stage.viewer.set_dirty();
  }

  // --- bar ---

  fillTimeline() {
    const { keyframes, gripper, duration } = this.replay;
    const share = (t) => `${(100 * Math.min(Math.max(t, 0), duration)) / (duration || 1)}%`;
    const place = (properties) => {
      const node = document.createElement("i");
      Object.assign(node.style, properties);
      return node;
    };
    element("marks").replaceChildren(...keyframes.map((k) => place({ left: share(k.t) })));
    const closed = closings(gripper, duration);
    element("grip").replaceChildren(...closed.map(([from, to]) => place({ left: share(from), width: `calc(${share(to)} - ${share(from)})` })));
    element("seek").max = duration;
    element("seek").step = 1 / this.replay.rate;
    element("speed").replaceChildren(...Player.speeds.map((speed) => this.make("option", `${speed}×`, { value: speed })));
  }

  listen() {
    const { player, stage } = this;
    element("play").onclick = () => player.toggle();
    element("previous").onclick = () => player.step(-1);
    element("next").onclick = () => player.step(1);
    element("seek").oninput = (event) => player.seek(Number(event.target.value));
    element("speed").onchange = (event) => { player.speed = Number(event.target.value); };
    const loop = () => { player.loop = !player.loop; player.show(); };
    const view = () => stage.frame(this.replay.extent);
    const fold = () => {
      element("fold").setAttribute("aria-pressed", !document.body.classList.toggle("folded"));
      stage.resize();
    };
    element("loop").onclick = loop;
    element("view").onclick = view;
    element("fold").onclick = fold;
    const frame = 1 / this.replay.rate;
    const keys = {
      " ": () => player.toggle(), k: () => player.toggle(),
      ArrowLeft: () => player.seek(player.time - 1), ArrowRight: () => player.seek(player.time + 1),
      j: () => player.seek(player.time - 5), l: () => player.seek(player.time + 5),
      ",": () => { player.pause(); player.seek(player.time - frame); }, ".": () => { player.pause(); player.seek(player.time + frame); },
      "<": () => player.faster(-1), ">": () => player.faster(1),
      Home: () => player.seek(0), End: () => player.seek(player.duration),
      n: () => player.step(1), p: () => player.step(-1), r: loop, v: view, d: fold,
    };
    for (let digit = 0; digit < 10; digit++) keys[digit] = () => player.seek((digit / 10) * player.duration);
    document.onkeydown = (event) => {
      const act = keys[event.key.length === 1 ? event.key.toLowerCase() : event.key];
      if (!act || event.ctrlKey || event.metaKey || event.altKey || event.target.tagName === "SELECT") return;
      event.preventDefault();
      act();
    };
  }
}
