"use strict";

// The replay's clock. It calls `show()` whenever the time or the state has changed.
class Player {
  static speeds = [0.1, 0.25, 0.5, 1, 2, 4];

  constructor(duration, marks, show) {
    this.duration = duration;
    this.marks = marks;
    this.show = show;
    this.time = 0;
    this.speed = 1;
    this.loop = true;
    this.playing = false;
    this.last = null;
  }

  play() {
    if (this.time >= this.duration) this.time = 0;
    this.playing = true;
    this.last = null;
    this.show();
    requestAnimationFrame((now) => this.tick(now));
  }

  pause() {
    this.playing = false;
    this.show();
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  seek(time) {
    this.time = Math.min(Math.max(time, 0), this.duration);
    this.show();
  }

  // Goes to the next or previous keyframe. During playback, shortly after a keyframe, "previous" is the one before it, as
  // in music players.
  step(direction) {
    const later = this.marks.filter((t) => t > this.time + 1e-3);
    const earlier = this.marks.filter((t) => t < this.time - (this.playing ? 0.5 : 1e-3));
    if (direction > 0) this.seek(later.length ? Math.min(...later) : this.duration);
    else this.seek(earlier.length ? Math.max(...earlier) : 0);
  }

  faster(direction) {
    const i = Player.speeds.indexOf(this.speed) + direction;
    this.speed = Player.speeds[Math.min(Math.max(i, 0), Player.speeds.length - 1)];
    this.show();
  }

  tick(now) {
    if (!this.playing) return;
    // A hidden tab gets no frames: the time must not jump when it is shown again.
    const elapsed = this.last === null ? 0 : Math.min(now - this.last, 250) / 1000;
    this.last = now;
    this.time += elapsed * this.speed;
    if (this.time >= this.duration) {
      this.time = this.loop && this.duration > 0 ? this.time % this.duration : this.duration;
      this.playing = this.loop && this.duration > 0;
    }
    this.show();
    requestAnimationFrame((later) => this.tick(later));
  }
}
