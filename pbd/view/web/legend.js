"use strict";

// What the colours in the scene mean, and switches to hide each.
class Legend {
  constructor(replay, stage) {
    this.stage = stage;
    const { speed, keyframes, obstacles } = replay;
    const unsure = keyframes.some((k) => k.sigma !== null);
    const rows = [
      ["hand_path", "the hand's path", "var(--speeds)"],
      ["tool_path", "the robot's tool", "#8c9199"],
      ["keyframes", "keyframes", "linear-gradient(90deg, #e04540 33%, #38a85c 33% 66%, #3875eb 66%)"],
      ...(unsure ? [["two_sigma", "uncertainty, 2 σ", "rgb(74 107 237 / 0.35)"]] : []),
      ...(stage.found("stand_in").length ? [["stand_in", "gripper (a stand-in)", "rgb(140 148 160 / 0.6)"]] : []),
      ...(obstacles.length ? [["obstacles", obstacles.join(", "), "#9e8c78"]] : []),
    ];
    element("switches").replaceChildren(...rows.map(([name, text, look]) => this.row(name, text, look)));
    element("speeds").hidden = speed === null;
    const [half, full] = [0.5 * speed, speed].map((value) => digits(value, 2));
    element("speeds").lastElementChild.replaceChildren(...["hand: 0", half, `${full} m/s`].map((mark) => make("span", mark)));
  }

  row(name, text, look) {
    const box = make("input", "", { type: "checkbox", checked: true, onchange: () => this.reveal(name, box.checked) });
    const row = make("label");
    row.style.setProperty("--look", look);
    row.append(box, make("span", text));
    return row;
  }

  reveal(name, visible) {
    const { stage } = this;
    for (const node of stage.found(name)) node.visible = visible;
    if (name === "keyframes") element("labels").hidden = !visible;
    stage.viewer.set_dirty();
  }
}
