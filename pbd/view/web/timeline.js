"use strict";

// The time axis: when the arm moves, makes a detour or touches something, when the gripper is closed, and the keyframes.
class Timeline {
  static apart_px = 16;

  constructor({ keyframes, moves, detours, closed, touching, duration }, seek) {
    this.duration = duration;
    this.numbers = keyframes.map((k, i) => this.place(make("span", `${i}${k.sure === null ? "" : "?"}`, { className: k.sure === null ? "" : "doubted" }), k.t));
    element("numbers").replaceChildren(...this.numbers);
    element("moves").replaceChildren(...this.spans(moves));
    element("detours").replaceChildren(...this.spans(detours));
    element("done").replaceChildren(...this.spans(moves));
    element("closed").replaceChildren(...this.spans(closed));
    element("touching").replaceChildren(...this.spans(touching.map(({ start, end }) => [start, end])));
    Object.assign(element("seek"), { max: duration, oninput: (event) => seek(Number(event.target.value)) });
    new ResizeObserver(() => this.thin()).observe(element("timeline"));
  }

  share(t) {
    return `${(100 * Math.min(Math.max(t, 0), this.duration)) / (this.duration || 1)}%`;
  }

  place(node, from) {
    node.style.left = this.share(from);
    return node;
  }

  spans(spans) {
    return spans.map(([from, to]) => {
      const span = this.place(make("i"), from);
      span.style.right = `calc(100% - ${this.share(to)})`;
      return span;
    });
  }

  // Leaves out numbers that would overlap their neighbours.
  thin() {
    let last = -Infinity;
    for (const number of this.numbers) {
      const x = (parseFloat(number.style.left) / 100) * element("timeline").clientWidth;
      const fits = x - last >= Timeline.apart_px;
      number.classList.toggle("mute", !fits);
      if (fits) last = x;
    }
  }

  show(time, current, words) {
    element("seek").value = time;
    element("seek").setAttribute("aria-valuetext", `${time.toFixed(2)} seconds, ${words}`);
    element("timeline").style.setProperty("--done", this.share(time));
    this.numbers.forEach((number, i) => number.classList.toggle("now", i === current));
  }
}
