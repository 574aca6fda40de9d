"use strict";

// Connects the parts of the page: the scene's description goes to each part, the user's input to the player.
class Page {
  constructor(stage, replay) {
    this.stage = stage;
    this.replay = replay;
    this.player = new Player(replay.duration, replay.keyframes.map((k) => k.t), () => this.show());
    this.describe();
    const seek = (time) => this.player.seek(time);
    this.keyframes = new KeyframeTable(replay.keyframes, seek);
    this.timeline = new Timeline(replay, seek);
    this.joints = new Joints(replay, seek);
    this.legend = new Legend(replay, stage);
    this.listen();
    for (const id of ["panel", "bar"]) element(id).hidden = false;
    this.folds = { panel: "(max-width: 640px)", joints: "(max-width: 640px), (max-height: 560px)" };
    for (const [id, small] of Object.entries(this.folds)) {
      const query = (this.folds[id] = matchMedia(small)); // kept: without a reference it may be garbage-collected
      query.onchange = () => this.fold(id, query.matches);
      this.fold(id, query.matches);
    }
    stage.drawOnTop("two_sigma");
    stage.start();
    stage.frame(replay.bounds);
    stage.addSurroundings(replay.table);
    stage.label(this.keyframes.labels, replay.keyframes.map((k) => k.p));
    this.player.seek(0);
  }

  show() {
    const { player, stage } = this;
    const { time, duration } = player;
    const current = this.replay.keyframes.filter((k) => k.t <= time + 1e-3).length - 1;
    const words = this.words(current, time);
    stage.show(time);
    document.body.classList.toggle("playing", player.playing);
    element("play").ariaLabel = player.playing ? "Pause" : "Play";
    const whole = duration.toFixed(2);
    element("time").firstElementChild.textContent = time.toFixed(2).padStart(whole.length, "\u2007"); // as wide as a digit
    element("time").lastElementChild.textContent = ` / ${whole} s`;
    element("phase").textContent = words;
    element("speed").value = player.speed;
    element("loop").setAttribute("aria-pressed", player.loop);
    this.keyframes.show(current);
    this.timeline.show(time, current, words);
    this.joints.show(time);
  }

  // What the arm does at this time. A move's end is up to 10 ms late.
  words(current, time) {
    const { keyframes, moves, duration } = this.replay;
    const at = keyframes[current]?.t;
    const end = moves.filter(([from]) => from <= time).at(-1)?.[1] ?? 0;
    const moving = time < Math.min(end, duration);
    if ((moving ? time : end) - at < 0.011) return `at ${this.keyframes.title(current)}`;
    if (!moving) return "at rest";
    return current < keyframes.length - 1 ? `to ${this.keyframes.title(current + 1)}` : "going back";
  }

  describe() {
    const { title, robot, duration, torque, notes, warnings, touching } = this.replay;
    document.title = `${title} \u2013 ${robot}`;
    element("title").textContent = title;
    element("license").textContent = `The robot's model and meshes: ${this.replay.license}.`;
    element("license").hidden = !this.replay.license;
    const torques = torque === null ? "" : ` \u00b7 torques up to ${(100 * torque).toFixed(0)}\u00a0% of the limits`;
    const contacts = touching.length > 1 ? ` \u00b7 ${touching.length}\u00a0contacts` : ""; // their list may be cut off
    element("subtitle").textContent = `${duration.toFixed(1)}\u00a0s \u00b7 ${robot}${torques}${contacts}`;
    const alarms = touching.map(({ message, start }) => {
      const alarm = make("li", "", { className: "alarm" });
      alarm.append(make("button", message, { title: "Go there", onclick: () => this.player.seek(start) }));
      return alarm;
    });
    element("notes").replaceChildren(
      ...alarms,
      ...warnings.map((warning) => make("li", warning, { className: "warning" })),
      ...notes.map((note) => make("li", note)),
    );
    element("notes").hidden = element("notes").children.length === 0;
    element("speed").replaceChildren(...Player.speeds.map((speed) => make("option", `${speed}×`, { value: speed })));
  }

  // Hides or shows the panel or the joints' plot.
  fold(id, hide = !document.body.classList.contains(`no-${id}`)) {
    document.body.classList.toggle(`no-${id}`, hide);
    document.querySelector(`[aria-controls="${id}"]`).setAttribute("aria-expanded", !hide);
    this.stage.resize();
  }

  listen() {
    const { player, stage } = this;
    const toggle = () => player.toggle();
    const by = (seconds) => () => player.seek(player.time + seconds);
    const step = (direction) => () => player.step(direction);
    const frame = (direction) => () => { player.pause(); player.seek(player.time + direction / this.replay.rate); };
    const loop = () => { player.loop = !player.loop; player.show(); };
    const turn = (direction) => () => stage.move((direction * Math.PI) / 12, 1);
    const zoom = (times) => () => stage.move(0, times);
    const view = () => stage.frame(this.replay.bounds);
    const [panel, joints] = ["panel", "joints"].map((id) => () => this.fold(id));
    const full = () => (document.fullscreenElement ? document.exitFullscreen() : document.documentElement.requestFullscreen());
    const tenths = Object.fromEntries(Array.from({ length: 10 }, (_, i) => [i, () => player.seek((i / 10) * player.duration)]));
    const keys = new Keys([
      ["play or pause", { " ": toggle, k: toggle }],
      ["one second back, forward", { ArrowLeft: by(-1), ArrowRight: by(1) }],
      ["five seconds back, forward", { j: by(-5), l: by(5) }],
      ["one frame back, forward", { ",": frame(-1), ".": frame(1) }],
      ["previous, next keyframe", { ArrowUp: step(-1), ArrowDown: step(1), p: step(-1), n: step(1) }],
      ["start, end", { Home: () => player.seek(0), End: () => player.seek(player.duration) }],
      ["to 0 % ... 90 %", tenths],
      ["slower, faster", { "<": () => player.faster(-1), ">": () => player.faster(1) }],
      ["repeat", { r: loop }],
      ["turn the scene", { q: turn(-1), e: turn(1) }],
      ["closer, farther", { "+": zoom(0.8), "-": zoom(1.25) }],
      ["whole scene", { v: view }],
      ["joints, details", { g: joints, d: panel }],
      ["full screen", { f: full }],
      ["these keys", { "?": () => keys.help() }],
    ]);
    const clicks = { play: toggle, previous: step(-1), next: step(1), loop, view, "show-joints": joints, "show-panel": panel, "show-help": () => keys.help() };
    for (const [id, act] of Object.entries(clicks)) element(id).onclick = act;
    element("speed").onchange = (event) => { player.speed = Number(event.target.value); };
  }
}
