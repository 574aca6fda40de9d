"use strict";

// The page during a recording: where the hand is now, and what it does, in letters that are legible from where a person
// demonstrates.
class LivePage {
  static glide_ms = 700;

  constructor(stage) {
    this.stage = stage;
    this.card = element("live");
    this.stops = 0;
    this.box = null;
    stage.robot = false;
    this.axes = ["x", "y", "z"].map((name) => make("i", name));
    for (const id of ["recording", "live"]) element(id).hidden = false;
    document.onkeydown = (event) => {
      if (event.key.toLowerCase() === "v" && !event.ctrlKey && !event.metaKey && !event.altKey) this.aim(true);
    };
  }

  take(state) {
    this.describe(state);
    const { stops, box } = state;
    if (stops !== this.stops || !this.stage.labels.length) this.numberStops(stops);
    if (String(box) === String(this.box)) return;
    this.box = box;
    this.aim(this.stage.framed);
  }

  describe({ title, subtitle, fast, state, badge, line, figures }) {
    document.title = `${badge} \u2013 ${title}`;
    const [heading, from] = element("recording").children;
    this.write(heading, title);
    this.write(from, subtitle);
    this.write(element("recording").querySelector(".speed span"), `hand, 0 \u2013 ${fast} m/s and more`);
    this.card.dataset.state = state;
    const [word, words, list] = this.card.children;
    this.write(word, badge);
    this.write(words, line);
    if (list.children.length !== figures.length) list.replaceChildren(...figures.map(() => make("li")));
    figures.forEach((figure, i) => this.write(list.children[i], figure));
  }

  write(node, text) {
    if (node.textContent !== text) node.textContent = text;
  }

  // The connection has ended. There is nothing to do if the recording had announced its end.
  gone() {
    if (this.card.dataset.state === "ended") return;
    this.card.dataset.state = "ended";
    this.write(this.card.children[0], "ended");
    this.write(this.card.children[1], "the recording sends no more data");
  }

  numberStops(stops) {
    this.stops = stops;
    const numbers = Array.from({ length: stops }, (_, i) => make("span", i));
    element("labels").replaceChildren(...this.axes, ...numbers);
    const tips = [[0.135, 0, 0], [0, 0.135, 0], [0, 0, 0.135]];
    const places = numbers.map((_, i) => this.stage.node("pbd", "stops", String(i), "triad").position);
    this.stage.label([...this.axes, ...numbers], [...tips, ...places]);
  }

  // Fits the camera to the box that it should show. It glides there, unless the user has moved it.
  aim(follow) {
    const { stage } = this;
    const { camera } = stage;
    const { target } = stage.viewer.controls;
    const [[x, y, z], [X, Y, Z]] = this.box;
    const first = !stage.bounds.length;
    const from = [camera.position.clone(), target.clone()];
    stage.framed = follow;
    stage.bounds = [x, X].flatMap((a) => [y, Y].flatMap((b) => [z, Z].map((c) => new stage.THREE.Vector3(a, b, c))));
    stage.resize();
    stage.addSurroundings(z);
    if (!follow || first || matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    this.glide(from, [camera.position.clone(), target.clone()]);
  }

  glide(from, to) {
    const { stage } = this;
    const begun = performance.now();
    const step = (this.gliding = () => {
      if (this.gliding !== step || !stage.framed) return; // a later glide began, or the user moved the camera
      const share = Math.min((performance.now() - begun) / LivePage.glide_ms, 1);
      const eased = share * share * (3 - 2 * share);
      stage.camera.position.lerpVectors(from[0], to[0], eased);
      stage.viewer.controls.target.lerpVectors(from[1], to[1], eased);
      stage.viewer.set_dirty();
      if (share < 1) requestAnimationFrame(step);
    });
    step();
  }
}
