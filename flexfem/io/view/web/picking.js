// What lies under the pointer: every layer is drawn once more, into one pixel, with numbers for
// colours.

import * as THREE from "three";

/** Finds layer, element and point under a pixel. */
export class Picker {
  constructor(stage, layers) {
    this.stage = stage;
    this.layers = layers.filter((layer) => layer.values || layer.data.kind === "frames");
    this.target = new THREE.WebGLRenderTarget(1, 1, {
      type: THREE.FloatType, minFilter: THREE.NearestFilter, magFilter: THREE.NearestFilter,
    });
    this.usable = stage.renderer.extensions.has("EXT_color_buffer_float");
    this.pixel = new Float32Array(4);
  }

  /** Return `{ layer, cell, point }` at a place of the canvas; null where nothing is. */
  at(x, y) {
    if (!this.usable) return null;
    const { renderer, camera, scene } = this.stage;
    const [width, height] = this.stage.window;
    const others = this.stage.scene.children.filter(
      (mesh) => mesh.visible && !this.layers.some((layer) => layer.mesh === mesh));
    others.forEach((mesh) => (mesh.visible = false));
    this.layers.forEach((layer, number) => {
      if (layer.edges) layer.mesh.remove(layer.edges);
      layer.uniforms.layer.value = number + 1;
      layer.uniforms.window?.value.set(1, 1); // lines are as wide as on the canvas
      layer.mesh.material = layer.pickMaterial;
    });
    const ground = renderer.getClearColor(new THREE.Color());
    camera.setViewOffset(width, height, x, y, 1, 1);
    renderer.setClearColor(0, 0);
    renderer.setRenderTarget(this.target);
    renderer.render(scene, camera);
    renderer.readRenderTargetPixels(this.target, 0, 0, 1, 1, this.pixel);
    renderer.setRenderTarget(null);
    renderer.setClearColor(ground, 1);
    camera.clearViewOffset();
    this.layers.forEach((layer) => {
      layer.mesh.material = layer.material;
      layer.uniforms.window?.value.set(width, height);
      if (layer.edges) layer.mesh.add(layer.edges);
    });
    others.forEach((mesh) => (mesh.visible = true));
    const [number, cell, depth] = this.pixel;
    if (!(number > 0)) return null;
    const point = new THREE.Vector3((2 * x + 1) / width - 1, 1 - (2 * y + 1) / height, 2 * depth - 1);
    return { layer: this.layers[number - 1], cell, point: point.unproject(camera).toArray() };
  }
}
