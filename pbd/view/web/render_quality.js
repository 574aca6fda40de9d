"use strict";

// How finely the scene is drawn. With a graphics card every frame is fine. Without one (software rendering), a moving
// scene is drawn coarsely and without shadows; once it stands still it is drawn finely.
class RenderQuality {
  static software = /swiftshader|llvmpipe|software|basic render/i;
  static coarse_pixels = 8e5;
  static settle_ms = 250;

  constructor(THREE) {
    this.THREE = THREE;
    const graphics = RenderQuality.graphics();
    this.none = graphics === null;
    this.slow = RenderQuality.software.test(graphics);
    this.renderer = this.none ? RenderQuality.blank() : new THREE.WebGLRenderer({ antialias: !this.slow, alpha: true });
    this.renderer.outputEncoding = THREE.sRGBEncoding;
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = THREE.PCFShadowMap;
    this.size = [window.innerWidth, window.innerHeight];
    this.caster = null; // the light that casts shadows, if the frame is fine
    this.settleTimer = null;
    this.fine = false; // whether the frame on the screen is fine
  }

  // The graphics card's name; null without WebGL.
  static graphics() {
    const gl = document.createElement("canvas").getContext("webgl");
    if (!gl) return null;
    let name = gl.getParameter(gl.RENDERER);
    if (name === "WebKit WebGL") name = gl.getParameter(gl.getExtension("WEBGL_debug_renderer_info").UNMASKED_RENDERER_WEBGL);
    gl.getExtension("WEBGL_lose_context")?.loseContext();
    return name;
  }

  // What the viewer calls of a renderer, without a picture.
  static blank() {
    const nothing = () => {};
    return { domElement: make("canvas"), shadowMap: {}, setSize: nothing, setPixelRatio: nothing, getPixelRatio: nothing, render: nothing };
  }

  resize(width, height) {
    this.size = [width, height];
    if (this.smoothTarget) this.smoothTarget.dispose();
    this.smoothTarget = null;
  }

  render(scene, camera) {
    if (!this.slow) {
      this.draw(scene, camera, Math.min(window.devicePixelRatio, 2), true);
      return;
    }
    const [width, height] = this.size;
    this.draw(scene, camera, Math.min(1, Math.sqrt(RenderQuality.coarse_pixels / (width * height))), false);
    clearTimeout(this.settleTimer);
    this.settleTimer = setTimeout(() => requestAnimationFrame(() => this.drawSmooth(scene, camera)), RenderQuality.settle_ms);
  }

  draw(scene, camera, ratio, shadows) {
    this.fine = shadows;
    if (this.renderer.getPixelRatio() !== ratio) this.renderer.setPixelRatio(ratio);
    if (this.caster) this.caster.castShadow = shadows;
    this.renderer.render(scene, camera);
  }

  // Antialiasing of the canvas would slow down coarse frames too, fourfold; so a multisampled texture is used here.
  drawSmooth(scene, camera) {
    const { THREE, renderer } = this;
    this.smoothTarget ??= new THREE.WebGLMultisampleRenderTarget(...this.size, {
      format: THREE.RGBAFormat,
      encoding: THREE.sRGBEncoding,
      stencilBuffer: true, // gives 24 bits of depth instead of 16, with which close surfaces flicker (z-fighting)
    });
    this.copy ??= new THREE.Mesh(
      new THREE.PlaneGeometry(2, 2),
      new THREE.ShaderMaterial({
        uniforms: { image: { value: null } },
        vertexShader: "varying vec2 at; void main() { at = uv; gl_Position = vec4(position.xy, 0.0, 1.0); }",
        fragmentShader: "uniform sampler2D image; varying vec2 at; void main() { gl_FragColor = texture2D(image, at); }",
        blending: THREE.NoBlending,
        depthTest: false,
      }),
    );
    renderer.setRenderTarget(this.smoothTarget);
    renderer.clear();
    this.draw(scene, camera, 1, true);
    renderer.setRenderTarget(null);
    this.copy.material.uniforms.image.value = this.smoothTarget.texture;
    renderer.render(this.copy, camera);
  }
}
