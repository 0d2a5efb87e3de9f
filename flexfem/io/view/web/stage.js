// The canvas: cameras, controls, grid and the axes of the ground.

import * as THREE from "three";
import { OrbitControls } from "three";
import { shown, styled } from "view/colours.js";

const DIRECTIONS = {
  corner: [0.8, -1.5, 0.8], x: [1, 0, 0], "−x": [-1, 0, 0], y: [0, 1, 0], "−y": [0, -1, 0],
  z: [0, 0, 1], "−z": [0, 0, -1],
};
const AXES = [["x", "#d0453a"], ["y", "#2fa35a"], ["z", "#3f7fd8"]];

/** Renders the scene whenever something has changed. */
export class Stage {
  /**
   * @param box least and greatest coordinates of the motion.
   * @param cloud places all over it: x, y, z and size.
   */
  constructor(canvas, box, cloud) {
    this.canvas = canvas;
    this.renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.renderer.debug.checkShaderErrors = false; // which would wait for each shader
    this.renderer.outputColorSpace = THREE.LinearSRGBColorSpace; // shaders write what screens show
    this.scene = new THREE.Scene();
    this.parallel = new THREE.OrthographicCamera();
    this.perspective = new THREE.PerspectiveCamera(30);
    this.camera = this.parallel;
    this.surround(box, cloud);
    this.look(...usualView(box));
    new ResizeObserver(() => this.resize()).observe(canvas);
    this.resize();
  }

  /** The motion has these bounds, and is all over these places. */
  surround(box, cloud) {
    Object.assign(this, { box, cloud });
    this.reach = Math.hypot(...box[1].map((high, c) => high - box[0][c])) || 1;
    this.grid?.removeFromParent();
    this.grid?.geometry.dispose();
    this.#makeGrid();
    this.invalidate();
  }

  /** Something has changed. */
  invalidate() {
    this.stale = true;
  }

  /** Names of the directions to look from. */
  get views() {
    return Object.keys(DIRECTIONS);
  }

  lookFrom(name) {
    const towards = DIRECTIONS[name];
    this.look(towards, Math.abs(towards[2]) === 1 ? [0, 1, 0] : [0, 0, 1]);
  }

  /** Look from a direction at the whole motion. */
  look(towards, up) {
    const direction = new THREE.Vector3(...towards).normalize();
    const right = new THREE.Vector3(...up).cross(direction).normalize();
    const upwards = direction.clone().cross(right);
    const centre = this.#fit(right, upwards);
    for (const camera of [this.parallel, this.perspective]) {
      camera.up.set(...up);
      camera.position.copy(centre).addScaledVector(direction, this.#away(camera));
    }
    this.parallel.zoom = 1;
    this.#control(centre);
    this.resize();
  }

  usePerspective(on) {
    const target = this.controls.target.clone();
    const from = this.camera;
    this.camera = on ? this.perspective : this.parallel;
    const away = from.position.clone().sub(target).normalize();
    const half = on ? this.span / this.parallel.zoom : from.position.distanceTo(target) * this.tangent;
    this.camera.up.copy(from.up);
    this.camera.position.copy(target).addScaledVector(away, on ? half / this.tangent : 2.2 * this.reach);
    if (!on) this.parallel.zoom = this.span / half;
    this.#control(target);
    this.resize();
  }

  get tangent() {
    return Math.tan((this.perspective.fov * Math.PI) / 360);
  }

  showGrid(on) {
    this.grid.visible = on;
    this.invalidate();
  }

  resize() {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio, 2));
    this.renderer.setSize(width, height, false);
    const aspect = width / height;
    this.window = [width, height];
    const half = this.span;
    Object.assign(this.parallel, { left: -half * aspect, right: half * aspect, top: half, bottom: -half });
    this.perspective.aspect = aspect;
    this.invalidate();
  }

  /** Render if something has changed; returns whether. */
  render() {
    this.controls.update();
    if (!this.stale) return false;
    this.stale = false;
    this.#clip();
    this.renderer.render(this.scene, this.camera);
    this.#drawAxes();
    return true;
  }

  /** Colours of light or dark. */
  paint() {
    this.renderer.setClearColor(new THREE.Color().setStyle(styled("--ground"), THREE.LinearSRGBColorSpace));
    this.grid.material.color.setStyle(styled("--grid"), THREE.LinearSRGBColorSpace);
    this.invalidate();
  }

  /** Place of a point on the canvas, in pixels. */
  project(point) {
    const seen = new THREE.Vector3(...point).project(this.camera);
    const [width, height] = this.window;
    return [0.5 * (seen.x + 1) * width, 0.5 * (1 - seen.y) * height];
  }

  #control(centre) {
    this.controls?.dispose();
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.target.copy(centre);
    this.controls.zoomToCursor = true;
    this.controls.addEventListener("change", () => this.invalidate());
    this.controls.update();
    this.invalidate();
  }

  /** Return the middle of what is seen, and set half of the height of what shows all of it. */
  #fit(right, up) {
    const { clientWidth: width, clientHeight: height } = this.canvas;
    const ends = [right, up].map((axis) => {
      let [low, high] = [Infinity, -Infinity];
      for (const [x, y, z, size] of this.cloud) {
        const at = x * axis.x + y * axis.y + z * axis.z;
        low = Math.min(low, at - size);
        high = Math.max(high, at + size);
      }
      return [low, high];
    });
    const [across, upwards] = ends.map(([low, high]) => 0.5 * (high - low));
    const free = Math.max(0.5, ((width || 3) - 190) / (height || 2)); // the legend is on the right
    this.span = 1.12 * Math.max(upwards, across / free, 0.02 * this.reach);
    const [u, v] = ends.map(([low, high]) => 0.5 * (low + high));
    const beside = (95 * 2 * this.span) / (height || 500);
    return new THREE.Vector3().addScaledVector(right, u + 0.7 * beside).addScaledVector(up, v + 0.03 * this.span);
  }

  /** Distance of a camera from what it looks at. */
  #away(camera) {
    return camera === this.parallel ? 2.2 * this.reach : (1.15 * this.span) / this.tangent;
  }

  #clip() {
    const away = this.camera.position.distanceTo(this.controls.target);
    const far = away + 4 * this.reach + this.controls.target.length();
    this.parallel.near = -far;
    this.perspective.near = Math.max(away - 2 * this.reach, 2e-3 * away);
    this.parallel.far = this.perspective.far = far;
    this.parallel.updateProjectionMatrix();
    this.perspective.updateProjectionMatrix();
  }

  /** Lines on the ground below the motion, at round distances. */
  #makeGrid() {
    const raw = this.reach / 12;
    const power = 10 ** Math.floor(Math.log10(raw));
    this.spacing = [1, 2, 5, 10].find((factor) => factor * power >= raw) * power;
    const level = this.box[0][2];
    const [u, v] = [0, 1].map((c) => [
      Math.floor(this.box[0][c] / this.spacing) - 1, Math.ceil(this.box[1][c] / this.spacing) + 1,
    ]);
    const points = [];
    const add = (a, b) => points.push(a * this.spacing, b * this.spacing, level);
    for (let a = u[0]; a <= u[1]; a++) v.forEach((b) => add(a, b));
    for (let b = v[0]; b <= v[1]; b++) u.forEach((a) => add(a, b));
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.Float32BufferAttribute(points, 3));
    this.grid = new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ toneMapped: false }));
    this.grid.renderOrder = -1;
    this.scene.add(this.grid);
    this.gridText = `${shown(this.spacing)} m`;
  }

  #drawAxes() {
    const canvas = document.getElementById("axes");
    const pen = canvas.getContext("2d");
    const { width } = canvas;
    pen.clearRect(0, 0, width, width);
    pen.lineWidth = 4;
    pen.font = "600 22px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    const turn = this.camera.matrixWorldInverse;
    const drawn = AXES.map(([name, colour], c) => {
      const axis = new THREE.Vector3().setComponent(c, 1).transformDirection(turn);
      return { name, colour, axis };
    }).sort((a, b) => a.axis.z - b.axis.z);
    for (const { name, colour, axis } of drawn) {
      const [x, y] = [0.5 * width + 0.34 * width * axis.x, 0.5 * width - 0.34 * width * axis.y];
      pen.strokeStyle = pen.fillStyle = colour;
      pen.beginPath();
      pen.moveTo(0.5 * width, 0.5 * width);
      pen.lineTo(x, y);
      pen.stroke();
      pen.fillText(name, x + 15 * axis.x, y - 15 * axis.y);
    }
  }
}

/** Across a flat motion, from a corner of others: direction to the viewer and upwards. */
function usualView([low, high]) {
  const extent = high.map((value, c) => value - low[c]);
  const thin = extent.indexOf(Math.min(...extent));
  const middle = [...extent].sort((a, b) => a - b)[1];
  if (extent[thin] >= 0.3 * middle) return [DIRECTIONS.corner, [0, 0, 1]];
  if (thin === 2) return [[0.001, -0.3, 1], [0, 1, 0]];
  return thin === 0 ? [[1, 0.22, 0.3], [0, 0, 1]] : [[0.22, -1, 0.3], [0, 0, 1]];
}
