"use strict";

// The scene on the page: the viewer, the camera, and the numbers at the keyframes. Its content comes as meshcat commands.
// The scene's axes are the robot's base, z up; three.js' world has y up.
class SceneView {
  static together_px = 12; // labels whose points are closer on the screen stand side by side
  static steps = 30; // a row of labels moves by at most half as many steps of 3 pixels
  static paper = [680, 400]; // size of the scene on paper, CSS pixels: narrower than a sheet of A4 or Letter

  constructor(pane) {
    this.THREE = MeshCat.THREE;
    this.quality = new RenderQuality(this.THREE);
    pane.append(this.quality.renderer.domElement);
    if (this.quality.none) pane.after(make("p", "This browser has no WebGL, so the scene isn't drawn: switch WebGL on.", { className: "message" }));
    document.body.classList.toggle("no-scene", this.quality.none);
    this.viewer = new MeshCat.Viewer(pane, true, this.quality.renderer);
    this.leaveOutControls(this.viewer.scene_tree);
    for (const name of ["Lights", "Grid", "Axes"]) this.viewer.delete_path([name]);
    this.viewer.hide_background();
    this.camera = this.viewer.camera;
    this.camera.fov = 32;
    this.viewer.controls.enableDamping = true;
    this.viewer.controls.dampingFactor = 0.15;
    this.viewer.controls.maxPolarAngle = 0.52 * Math.PI;
    this.labels = [];
    this.bounds = [];
    this.framed = true; // until the user moves the camera
    this.robot = true; // whether there is a robot, which may need a pedestal
    this.printing = false;
    this.viewer.controls.addEventListener("start", () => { this.framed = false; });
    this.viewer.render = () => this.render();
    window.addEventListener("resize", () => this.resize());
    window.addEventListener("beforeprint", () => this.print());
    window.addEventListener("afterprint", () => { this.printing = false; this.resize(); });
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.addSurroundings(this.table));
  }

  // The viewer's own panel is hidden (page.css). It would grow by dozens of elements for each stop of a recording.
  leaveOutControls(tree) {
    const folder = { addFolder: () => folder, removeFolder() {}, __folders: {} };
    tree.folder = folder;
    Object.assign(tree.constructor.prototype, { create_controls() {}, vis_controller: { updateDisplay() {} } });
  }

  // Replaces the viewer's own method.
  render() {
    this.viewer.needs_render = false; // before the controls, whose damping asks for the next frame
    this.viewer.controls.update();
    this.camera.near = this.camera.position.distanceTo(this.viewer.controls.target) / 40;
    this.camera.updateProjectionMatrix();
    this.quality.render(this.viewer.scene, this.camera);
    this.placeLabels();
  }

  node(...path) {
    return this.viewer.scene_tree.find(path).object;
  }

  // All nodes with a name, anywhere in the scene.
  nodesNamed(name, tree = this.viewer.scene_tree) {
    return Object.entries(tree.children).flatMap(([key, child]) => [...(key === name ? [child.object] : []), ...this.nodesNamed(name, child)]);
  }

  // Draws all nodes with a name over everything else: small ellipsoids would be hidden inside other bodies.
  drawOnTop(name) {
    for (const node of this.nodesNamed(name)) {
      node.traverse((part) => {
        part.renderOrder = 1;
        if (part.material) part.material.depthTest = false;
      });
    }
  }

  // --- motion ---

  // The viewer's own clock is paused, as the player sets the time. Its actions must have been started once for that.
  start() {
    this.viewer.animator.play();
    this.viewer.animator.pause();
  }

  show(time) {
    for (const action of this.viewer.animator.actions) action.time = Math.min(time, action.getClip().duration);
    this.viewer.animator.mixer.update(0);
    this.viewer.set_dirty();
  }

  // Makes light, ground and pedestal; `table` is its height in base, or null.
  addSurroundings(table) {
    this.table = table;
    this.surroundings?.dispose();
    this.surroundings = new Surroundings(this.THREE, this.bounds, table, this.robot);
    this.viewer.scene.add(this.surroundings.group);
    this.quality.caster = this.surroundings.key;
    this.viewer.set_dirty();
  }

  // --- camera ---

  // Points (x, y, z) in base that the camera should show.
  frame(bounds) {
    this.bounds = bounds.map((p) => new this.THREE.Vector3(...p));
    this.framed = true;
    this.resize();
  }

  // Fits the scene into the window, beside the panel and above the bar.
  resize() {
    if (this.printing) return; // a small sheet folds what a small window folds
    const [width, height] = [window.innerWidth, window.innerHeight];
    const rectangle = (id) => (document.getElementById(id).offsetParent === null ? null : document.getElementById(id).getBoundingClientRect());
    const panel = rectangle("panel");
    const bar = rectangle("bar") ?? rectangle("live");
    this.fill([width, height], [panel && width > 640 ? panel.left : width, bar ? bar.top : height]);
  }

  // Draws the scene for paper. What is printed is a copy: Chromium with a graphics card prints an empty WebGL canvas.
  print() {
    if (!this.surroundings) return;
    this.printing = true;
    this.fill(SceneView.paper, SceneView.paper);
    this.surroundings.disc.visible = false; // dark on a dark page, but paper is white
    this.quality.draw(this.viewer.scene, this.camera, 2, true);
    this.surroundings.disc.visible = true;
    const { domElement } = this.quality.renderer;
    const copy = domElement.cloneNode();
    copy.getContext("2d").drawImage(domElement, 0, 0);
    domElement.replaceWith(copy);
    window.addEventListener("afterprint", () => copy.replaceWith(domElement), { once: true });
    this.placeLabels();
  }

  // Sets the size of the picture; the scene is fitted into the free part at its top left.
  fill([width, height], [freeWidth, freeHeight]) {
    this.viewer.set_3d_pane_size(width, height);
    this.quality.resize(width, height);
    this.camera.setViewOffset(width, height, (width - freeWidth) / 2, (height - freeHeight) / 2, width, height);
    if (this.framed && this.bounds.length) this.fit(freeWidth / width, freeHeight / height);
    this.viewer.set_dirty();
  }

  // Moves the camera, along a fixed direction, as near as all points still lie in the free part of the window.
  fit(shareX, shareY) {
    const { THREE } = this;
    const back = new THREE.Vector3(0.88, 0.42, 0.74).normalize(); // in three's world: from the front, right, above
    const right = new THREE.Vector3(0, 1, 0).cross(back).normalize();
    const up = back.clone().cross(right);
    const points = this.bounds.map((p) => new THREE.Vector3(p.x, p.z, -p.y));
    const tangent = Math.tan((this.camera.fov * Math.PI) / 360);
    const margin = 1.1;
    const target = new THREE.Box3().setFromPoints(points).getCenter(new THREE.Vector3());
    let distance = 0;
    for (let round = 0; round < 4; round++) {
      const seen = points.map((p) => p.clone().sub(target)).map((p) => [p.dot(right), p.dot(up), p.dot(back)]);
      const need = ([x, y, z]) => z + margin * Math.max(Math.abs(x) / (tangent * this.camera.aspect * shareX), Math.abs(y) / (tangent * shareY));
      distance = Math.max(...seen.map(need));
      const middle = (i) => {
        const slopes = seen.map((p) => p[i] / (distance - p[2]));
        return (distance * (Math.max(...slopes) + Math.min(...slopes))) / 2;
      };
      target.addScaledVector(right, middle(0)).addScaledVector(up, middle(1));
    }
    const { controls } = this.viewer;
    controls.enableDamping = false; // else the rest of a damped rotation would move the camera on
    controls.update();
    this.camera.position.copy(target).addScaledVector(back, distance);
    controls.target.copy(target);
    controls.maxDistance = 6 * distance;
    controls.update();
    controls.enableDamping = true;
  }

  // Turns the camera about the vertical through its target and multiplies its distance, as a drag and a wheel do.
  move(radians, times) {
    this.framed = false;
    const { controls } = this.viewer;
    const offset = this.camera.position.sub(controls.target).applyAxisAngle(this.camera.up, radians);
    offset.multiplyScalar(times).add(controls.target);
    controls.update();
    this.viewer.set_dirty();
  }

  // --- labels ---

  // Puts elements a little above points in base. An element follows a vector that changes.
  label(elements, points) {
    const vector = (point) => (point.isVector3 ? point : new this.THREE.Vector3(...point));
    this.labels = elements.map((element, i) => ({ element, point: vector(points[i]) }));
  }

  // Labels of (nearly) one point stand in a row. A row that would overlap another one moves up or down, and is left out
  // where it would move too far from its point. The current keyframe's row stays.
  placeLabels() {
    const rows = [];
    const [width, height] = this.quality.size;
    // Read before any style is set: each reading after that would lay out the page again.
    const widths = new Map(this.labels.map(({ element }) => [element, element.offsetWidth]));
    for (const { element, point } of this.labels) {
      const seen = this.viewer.scene.localToWorld(point.clone()).project(this.camera);
      element.style.visibility = Math.abs(seen.z) < 1 ? "visible" : "hidden";
      const above = element.matches("i") ? 0 : 22; // the name of an axis stands at its tip
      const [x, y] = [(0.5 + 0.5 * seen.x) * width, (0.5 - 0.5 * seen.y) * height - above];
      let row = rows.find((each) => each.width < width / 2 && Math.hypot(each.x - x, each.y - y) < SceneView.together_px);
      if (!row) rows.push((row = { x, y, width: 0, elements: [] }));
      row.elements.push(element);
      row.width += widths.get(element) + 1;
    }
    const current = (row) => row.elements.some((element) => element.matches(".now"));
    rows.sort((a, b) => current(b) - current(a));
    const placed = [];
    for (const row of rows) {
      const overlaps = (other) => Math.abs(row.x - other.x) < (row.width + other.width) / 2 && Math.abs(row.y - other.y) < 22;
      for (let k = 1; k <= SceneView.steps && placed.some(overlaps); k++) row.y += (k % 2 ? -3 : 3) * k; // up, down, further up, ...
      if (placed.some(overlaps)) {
        for (const element of row.elements) element.style.visibility = "hidden";
        continue;
      }
      placed.push(row);
      let left = row.x - row.width / 2;
      for (const element of row.elements) {
        element.style.transform = `translate(${left.toFixed(1)}px, ${row.y.toFixed(1)}px) translateY(-50%)`;
        left += widths.get(element) + 1;
      }
    }
  }
}
