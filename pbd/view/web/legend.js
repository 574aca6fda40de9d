"use strict";

// The meaning of the scene's colours, with a switch for each part.
class Legend {
  static magnification = 5;

  constructor(replay, stage) {
    this.stage = stage;
    const { speed, keyframes, obstacles } = replay;
    const unsure = keyframes.some((k) => k.sigma !== null);
    this.hideLargest(replay);
    const hidden = this.tooLarge.size ? `; ${this.tooLarge.size} too large to draw` : "";
    const rows = [
      ["hand_path", "hand's path", "var(--speeds)"],
      ["tool_path", "tool's path", "#8c9199"],
      ...(replay.detours.length ? [["detour", "detour", "var(--detour)"]] : []),
      ["keyframes", "keyframes", "linear-gradient(90deg, #e04540 33%, #38a85c 33% 66%, #3875eb 66%)"],
      ...(unsure ? [["two_sigma", `uncertainty, 2 σ${hidden}`, "var(--unsure)", this.magnifier()]] : []),
      ...(stage.nodesNamed("tolerance").length ? [["tolerance", "tolerance", "var(--tolerance)"]] : []),
      ...(stage.nodesNamed("placeholder").length ? [["placeholder", "the tool", "rgb(140 148 160 / 0.6)"]] : []),
      ...(stage.nodesNamed("object").length ? [["object", "grasped object", "#298c87"]] : []),
      ...(obstacles.length ? [["obstacles", obstacles.join(", "), "#9e8c78"]] : []),
    ];
    element("switches").replaceChildren(...rows.map((row) => this.row(...row)));
    const [half, full] = [0.5 * speed, speed].map((value) => digits(value, 2));
    element("speeds").lastElementChild.replaceChildren(...["hand: 0", half, `${full} m/s`].map((mark) => make("span", mark)));
  }

  row(name, text, look, ...more) {
    const box = make("input", "", { type: "checkbox", checked: true, ariaLabel: text, onchange: () => this.reveal(name, box.checked) });
    const row = make("label", "", { title: text }); // a long one is cut off
    row.style.setProperty("--look", look);
    row.append(box, make("span", text), ...more);
    return row;
  }

  // An ellipsoid whose semi-axis exceeds half the scene's width is not drawn: it would hide everything else, or contain
  // the camera. The table has its sigma.
  hideLargest({ keyframes, bounds }) {
    const width = Math.max(...[0, 1].map((axis) => Math.max(...bounds.map((p) => p[axis])) - Math.min(...bounds.map((p) => p[axis]))));
    const large = keyframes.flatMap((k, i) => (k.sigma !== null && 2 * k.sigma[0] > 0.5 * width ? [i] : []));
    this.tooLarge = new Set(large.map((i) => this.stage.node("pbd", "keyframes", String(i), "two_sigma")));
    for (const node of this.tooLarge) node.visible = false;
  }

  // A good sensor's ellipsoids are small; this button enlarges them.
  magnifier() {
    const button = make("button", `${Legend.magnification}×`, { title: `Draw the ellipsoids ${Legend.magnification} times as large` });
    button.setAttribute("aria-pressed", "false");
    button.onclick = () => {
      const larger = button.getAttribute("aria-pressed") === "false";
      button.setAttribute("aria-pressed", larger);
      for (const node of this.stage.nodesNamed("two_sigma")) {
        for (const ball of node.children) ball.scale.multiplyScalar(larger ? Legend.magnification : 1 / Legend.magnification);
      }
      this.stage.viewer.set_dirty();
    };
    return button;
  }

  reveal(name, visible) {
    const { stage } = this;
    for (const node of stage.nodesNamed(name)) node.visible = visible && !this.tooLarge.has(node);
    if (name === "keyframes") element("labels").hidden = !visible;
    stage.viewer.set_dirty();
  }
}
