"use strict";

// How the scene looks: light, ground, camera, and the numbers at the keyframes. What is in it came as meshcat commands.
// The scene's own axes are the robot's base, z up; three.js' world has y up.
class Stage {
  constructor(pane) {
    this.THREE = MeshCat.THREE;
    this.quality = new Quality(this.THREE);
    pane.append(this.quality.renderer.domElement);
    this.viewer = new MeshCat.Viewer(pane, true, this.quality.renderer);
    for (const name of ["Lights", "Grid", "Axes"]) this.viewer.delete_path([name]);
    this.viewer.hide_background();
    this.camera = this.viewer.camera;
    this.camera.fov = 32;
    this.viewer.controls.enableDamping = true;
    this.viewer.controls.dampingFactor = 0.15;
    this.viewer.controls.maxPolarAngle = 0.52 * Math.PI;
    this.labels = [];
    this.extent = [];
    this.framed = true; // until someone moves the camera
    this.robot = true; // stands there, or on something
    this.viewer.controls.addEventListener("start", () => { this.framed = false; });
    this.viewer.render = () => this.render();
    window.addEventListener("resize", () => this.resize());
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.furnish(this.table));
  }

  // In place of the viewer's own.
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

  // --- motion ---

  // The viewer's own clock stays still; ours sets the time. An action must have been started once to take part.
  start() {
    this.viewer.animator.play();
    this.viewer.animator.pause();
  }

  show(time) {
    for (const action of this.viewer.animator.actions) action.time = Math.min(time, action.getClip().duration);
    this.viewer.animator.mixer.update(0);
    this.viewer.set_dirty();
  }

  // --- light and ground ---

  furnish(table) {
    const { THREE } = this;
    this.table = table;
    if (this.furniture) this.viewer.scene.remove(this.furniture);
    this.furniture = new THREE.Group();
    this.viewer.scene.add(this.furniture);
    const box = new THREE.Box3().setFromPoints(this.extent);
    const size = box.getSize(new THREE.Vector3()).length();
    this.light(box.getCenter(new THREE.Vector3()), size);
    const floor = Math.min(table ?? 0, 0);
    this.ground(floor, 0.9 * size);
    if (this.robot && table > 0.005) this.slab(box, table);
    if (this.robot && floor < -0.005) this.pedestal(floor);
    this.viewer.set_dirty();
  }

  light(centre, size) {
    const { THREE } = this;
    const strength = Number(this.style("--light"));
    const sky = new THREE.HemisphereLight(0xffffff, 0xa9adb8, 0.5 * strength);
    sky.position.set(0, 0, 1);
    const key = new THREE.DirectionalLight(0xfffaf2, 0.5 * strength);
    key.position.set(0.45, -0.55, 1.25).multiplyScalar(size).add(centre);
    key.target.position.copy(centre);
    key.shadow.mapSize.set(1024, 1024);
    key.shadow.radius = 2.5;
    key.shadow.bias = -0.0006;
    key.shadow.normalBias = 0.004;
    const reach = 0.62 * size;
    Object.assign(key.shadow.camera, { left: -reach, right: reach, top: reach, bottom: -reach, near: 0.1, far: 3 * size });
    const rim = new THREE.DirectionalLight(0xdfe6ff, 0.2 * strength);
    rim.position.set(-0.8, 0.9, 0.5).multiplyScalar(size).add(centre);
    rim.target.position.copy(centre);
    this.furniture.add(sky, key, key.target, rim, rim.target);
    this.quality.caster = key;
  }

  ground(z, radius) {
    const { THREE } = this;
    const disc = new THREE.CircleGeometry(radius, 96);
    const top = new THREE.Mesh(disc, new THREE.MeshBasicMaterial({ map: this.glow(), transparent: true, depthWrite: false }));
    const shade = new THREE.Mesh(disc, new THREE.ShadowMaterial({ opacity: Number(this.style("--shadow")) }));
    shade.receiveShadow = true;
    top.renderOrder = -2;
    shade.renderOrder = -1;
    top.position.z = z - 0.002;
    shade.position.z = z - 0.0015;
    const lines = this.grid(radius);
    lines.position.z = z - 0.001;
    this.furniture.add(top, shade, lines);
  }

  // A disc of light that fades into the page's background.
  glow() {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 256;
    const paint = canvas.getContext("2d");
    const fade = paint.createRadialGradient(128, 128, 0, 128, 128, 128);
    const colour = new this.THREE.Color(this.style("--table"));
    const rgb = [colour.r, colour.g, colour.b].map((c) => Math.round(255 * c)).join(" ");
    for (const [at, alpha] of [[0, 0.85], [0.45, 0.55], [1, 0]]) fade.addColorStop(at, `rgb(${rgb} / ${alpha})`);
    paint.fillStyle = fade;
    paint.fillRect(0, 0, 256, 256);
    const texture = new this.THREE.CanvasTexture(canvas);
    texture.encoding = this.THREE.sRGBEncoding;
    return texture;
  }

  // Lines every 10 cm (further apart where there is much room), each fifth stronger, that fade toward the rim.
  grid(radius) {
    const { THREE } = this;
    const colour = new THREE.Color(this.style("--line")).convertSRGBToLinear();
    const points = [];
    const rgba = [];
    const step = 0.1 * 10 ** Math.max(0, Math.ceil(Math.log10(radius / 8)));
    const reach = Math.floor(radius / step);
    const vertex = (x, y, strength) => {
      const fade = Math.max(0, 1 - Math.hypot(x, y) / radius);
      points.push(x, y, 0);
      rgba.push(colour.r, colour.g, colour.b, strength * fade * fade);
    };
    for (let i = -reach; i <= reach; i++) {
      const strength = i % 5 ? 0.28 : 0.75;
      for (let k = -reach; k < reach; k++) {
        if (Math.hypot(i, k) > reach + 1) continue;
        for (const end of [step * k, step * (k + 1)]) vertex(step * i, end, strength);
        for (const end of [step * k, step * (k + 1)]) vertex(end, step * i, strength);
      }
    }
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    geometry.setAttribute("color", new THREE.Float32BufferAttribute(rgba, 4));
    return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ vertexColors: true, transparent: true, depthWrite: false }));
  }

  // A table that stands higher than the robot's foot: a board in front of the robot, under all that moves there.
  slab(box, z) {
    const { THREE } = this;
    const front = Math.max(box.max.x, 0.4);
    const board = new THREE.Mesh(
      new THREE.BoxGeometry(Math.max(front - 0.2, 0.2), box.max.y - box.min.y, 0.02),
      new THREE.MeshPhongMaterial({ color: new THREE.Color(this.style("--table")).convertSRGBToLinear() }),
    );
    board.position.set(0.2 + (front - 0.2) / 2, (box.max.y + box.min.y) / 2, z - 0.011);
    board.receiveShadow = board.castShadow = true;
    this.furniture.add(board);
  }

  // What the robot stands on where the table lies lower than its foot.
  pedestal(floor) {
    const { THREE } = this;
    const column = new THREE.Mesh(
      new THREE.CylinderGeometry(0.09, 0.11, -floor, 48).rotateX(Math.PI / 2),
      new THREE.MeshPhongMaterial({ color: new THREE.Color(this.style("--line")).convertSRGBToLinear() }),
    );
    column.position.z = floor / 2 - 0.001;
    column.receiveShadow = column.castShadow = true;
    this.furniture.add(column);
  }

  style(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }

  // --- camera ---

  // Points (x, y, z) in base that the camera should show.
  frame(extent) {
    this.extent = extent.map((p) => new this.THREE.Vector3(...p));
    this.framed = true;
    this.resize();
  }

  resize() {
    const [width, height] = [window.innerWidth, window.innerHeight];
    this.viewer.set_3d_pane_size(width, height);
    const covered = (id) => (document.getElementById(id).offsetParent === null ? null : document.getElementById(id).getBoundingClientRect());
    const panel = covered("panel");
    const bar = covered("bar") ?? covered("hand");
    const free = { width: panel && width > 640 ? panel.left : width, height: bar ? bar.top : height };
    this.quality.resize(width, height);
    this.camera.setViewOffset(width, height, (width - free.width) / 2, (height - free.height) / 2, width, height);
    if (this.framed && this.extent.length) this.fit(free.width / width, free.height / height);
    this.viewer.set_dirty();
  }

  // The nearest place, along a fixed direction, from which every point lies in the free part of the window.
  fit(shareX, shareY) {
    const { THREE } = this;
    const back = new THREE.Vector3(0.88, 0.42, 0.74).normalize(); // in three's world: from the front, right, above
    const right = new THREE.Vector3(0, 1, 0).cross(back).normalize();
    const up = back.clone().cross(right);
    const points = this.extent.map((p) => new THREE.Vector3(p.x, p.z, -p.y));
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
    this.camera.position.copy(target).addScaledVector(back, distance);
    this.viewer.controls.target.copy(target);
    this.viewer.controls.maxDistance = 6 * distance;
    this.viewer.controls.update();
  }

  // --- labels ---

  // Puts elements at points in base, a little above them. A vector may move on, and the element with it.
  label(elements, points) {
    const vector = (point) => (point.isVector3 ? point : new this.THREE.Vector3(...point));
    this.labels = elements.map((element, i) => ({ element, point: vector(points[i]) }));
  }

  placeLabels() {
    const taken = [];
    for (const { element, point } of this.labels) {
      const seen = this.viewer.scene.localToWorld(point.clone()).project(this.camera);
      const x = (0.5 + 0.5 * seen.x) * window.innerWidth;
      let y = (0.5 - 0.5 * seen.y) * window.innerHeight - 22;
      while (taken.some((other) => Math.abs(other.x - x) < 22 && Math.abs(other.y - y) < 21)) y -= 3;
      taken.push({ x, y });
      element.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px) translate(-50%, -50%)`;
      element.style.visibility = Math.abs(seen.z) < 1 ? "visible" : "hidden";
    }
  }
}
