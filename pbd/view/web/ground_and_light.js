"use strict";

// The surroundings of the scene: light, the ground or the table, and the robot's pedestal. Colours come from page.css.
class Surroundings {
  // `bounds`: points around the whole scene. `table`: its height in m, or null. `robot`: whether there is a robot.
  constructor(THREE, bounds, table, robot) {
    this.THREE = THREE;
    this.group = new THREE.Group();
    const box = new THREE.Box3().setFromPoints(bounds);
    const size = box.getSize(new THREE.Vector3()).length();
    this.light(box.getCenter(new THREE.Vector3()), size);
    const floor = Math.min(table ?? 0, 0);
    this.ground(floor, 0.9 * size);
    if (robot && table > 0.005) this.slab(box, table);
    if (robot && floor < -0.005) this.pedestal(floor, 0.09 * size);
  }

  // Removes it from the scene, and from the graphics card's memory.
  dispose() {
    this.group.removeFromParent();
    this.key.dispose();
    this.group.traverse(({ geometry, material }) => {
      for (const each of [geometry, material, material?.map]) each?.dispose();
    });
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
    this.group.add(sky, key, key.target, rim, rim.target);
    this.key = key;
  }

  ground(z, radius) {
    const { THREE } = this;
    const circle = new THREE.CircleGeometry(radius, 96);
    this.disc = new THREE.Mesh(circle, new THREE.MeshBasicMaterial({ map: this.glow(), transparent: true, depthWrite: false }));
    const shade = new THREE.Mesh(circle, new THREE.ShadowMaterial({ opacity: Number(this.style("--shadow")) }));
    shade.receiveShadow = true;
    this.disc.renderOrder = -2;
    shade.renderOrder = -1;
    this.disc.position.z = z - 0.002;
    shade.position.z = z - 0.0015;
    const lines = this.grid(radius);
    lines.position.z = z - 0.001;
    this.group.add(this.disc, shade, lines);
  }

  // The texture of a light disc that fades into the page's background.
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

  // Lines every 10 cm (1 m in a large scene), every fifth stronger, which fade towards the rim.
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

  // A table that is higher than the robot's base: a board in front of the robot.
  slab(box, z) {
    const { THREE } = this;
    const front = Math.max(box.max.x, 0.4);
    const board = new THREE.Mesh(
      new THREE.BoxGeometry(Math.max(front - 0.2, 0.2), box.max.y - box.min.y, 0.02),
      new THREE.MeshPhongMaterial({ color: new THREE.Color(this.style("--table")).convertSRGBToLinear() }),
    );
    board.position.set(0.2 + (front - 0.2) / 2, (box.max.y + box.min.y) / 2, z - 0.011);
    board.receiveShadow = board.castShadow = true;
    this.group.add(board);
  }

  // A column below the robot's base where the table is lower.
  pedestal(floor, radius) {
    const { THREE } = this;
    const column = new THREE.Mesh(
      new THREE.CylinderGeometry(radius, 1.2 * radius, -floor, 48).rotateX(Math.PI / 2),
      new THREE.MeshPhongMaterial({ color: new THREE.Color(this.style("--line")).convertSRGBToLinear() }),
    );
    column.position.z = floor / 2 - 0.001;
    column.receiveShadow = column.castShadow = true;
    this.group.add(column);
  }

  style(name) {
    return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  }
}
