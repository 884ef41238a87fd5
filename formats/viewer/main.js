// Shows one scene: its Gaussians at any moment, from anywhere, with the cameras of the clip as stops.
import { ExtSplats, SparkRenderer, SplatMesh } from "@sparkjsdev/spark";
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { unpack } from "./scene.js";

const NEAR = 0.05;
const FAR = 5000;
// Slower than this is what a network says of things that stand, metres a second.
const MOVES = 0.5;
// How far ahead of a camera the point lies that a drag turns around, metres.
const TURN_DISTANCE = 12;

export async function start(bytes, { title, stops, span }) {
  const page = new Page(unpack(bytes), title, stops, span);
  await page.show(0);
  page.loop();
  return page;
}

class Page {
  constructor(scene, title, stops, span) {
    Object.assign(this, { gaussians: scene, stops, span, time: NaN, isPlaying: false, isMoving: false });
    this.renderer = new THREE.WebGLRenderer({ antialias: false, preserveDrawingBuffer: true });
    this.renderer.setClearColor(0x000000, 1);
    this.canvas = this.renderer.domElement;
    document.getElementById("stage").append(this.canvas);
    // As the engine draws: down to an alpha of 1/255, front to back by depth along the camera's axis.
    this.spark = new SparkRenderer({
      renderer: this.renderer,
      autoUpdate: false,
      accumExtSplats: true,
      sortRadial: false,
      maxStdDev: 3.33,
      minAlpha: 1 / 255,
      blurAmount: 0,
      maxPixelRadius: 4096,
      clipXY: 4,
      enableLod: false,
    });
    this.splats = splatsOf(scene);
    this.mesh = new SplatMesh({ extSplats: this.splats, enableLod: false });
    this.world = new THREE.Scene();
    this.world.add(this.spark, this.mesh);
    this.camera = new THREE.PerspectiveCamera();
    this.camera.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.camera, this.canvas);
    this.controls.addEventListener("start", () => (this.isMoving = true));
    this.moving = [];
    for (let i = 0; i < scene.count; i++) {
      if (scene.velocities[3 * i] || scene.velocities[3 * i + 1] || scene.velocities[3 * i + 2]) this.moving.push(i);
    }
    this.panel(title);
    addEventListener("resize", () => this.fit());
    addEventListener("keydown", (event) => this.key(event));
  }

  panel(title) {
    const of = (id) => document.getElementById(id);
    const count = this.gaussians.count.toLocaleString("en");
    of("title").textContent = title;
    const speed = (i) => Math.hypot(...this.gaussians.velocities.subarray(3 * i, 3 * i + 3));
    const fast = this.moving.filter((i) => speed(i) > MOVES).length.toLocaleString("en");
    of("count").textContent = `${count} Gaussians, ${fast} of them faster than ${MOVES} m/s`;
    const list = of("stops");
    this.stops.forEach((stop, index) => list.append(new Option(`${stop.name}  ${stop.time.toFixed(2)} s`, index)));
    list.addEventListener("change", () => this.show(Number(list.value)));
    const slider = of("time");
    [slider.min, slider.max] = this.span;
    slider.addEventListener("input", () => this.setTime(Number(slider.value)));
    of("play").addEventListener("click", () => this.play(!this.isPlaying));
    document.body.classList.toggle("no-stops", this.stops.length === 0);
  }

  key(event) {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (event.target.tagName !== "INPUT" && step && this.stops.length > 0) {
      const next = (this.stop + step + this.stops.length) % this.stops.length;
      this.show(next);
      event.preventDefault();
    } else if (event.key === " " && event.target.tagName !== "BUTTON") {
      this.play(!this.isPlaying);
      event.preventDefault();
    }
  }

  play(isPlaying) {
    this.isPlaying = isPlaying;
    this.last = performance.now();
    document.getElementById("play").textContent = isPlaying ? "Pause" : "Play";
  }

  // Stands where an image was taken, at its moment.
  async show(index) {
    this.stop = index;
    this.isMoving = false;
    const stop = this.stops[index];
    document.getElementById("stops").value = index;
    const pose = new THREE.Matrix4().set(...stop.scene_from_camera);
    const forward = new THREE.Vector3(pose.elements[8], pose.elements[9], pose.elements[10]);
    // three.js looks along -z with y up; the clip's cameras look along +z with y down.
    const turned = pose.clone().multiply(new THREE.Matrix4().makeScale(1, -1, -1));
    turned.decompose(this.camera.position, this.camera.quaternion, new THREE.Vector3());
    this.controls.target.copy(this.camera.position).addScaledVector(forward, TURN_DISTANCE);
    this.fit();
    this.setTime(stop.time);
    await this.draw();
  }

  // The largest picture of the stop's shape that the window holds, or the stop's own size.
  fit() {
    const stop = this.stops[this.stop];
    const stage = document.getElementById("stage");
    const scale = document.body.classList.contains("bare")
      ? 1
      : Math.min(stage.clientWidth / stop.width, stage.clientHeight / stop.height);
    const [width, height] = [stop.width * scale, stop.height * scale].map((side) => Math.max(1, Math.round(side)));
    this.renderer.setSize(width, height);
    // The engine widens every footprint by 0.3 px^2 of the image's own size: without it gaps show where the picture is larger.
    this.spark.preBlurAmount = 0.3 * Math.max(1, scale * scale);
    const { fx, fy, cx, cy, width: w, height: h } = stop;
    const sides = [-cx / fx, (w - cx) / fx, cy / fy, -(h - cy) / fy].map((slope) => slope * NEAR);
    this.camera.projectionMatrix.makePerspective(...sides, NEAR, FAR);
    this.camera.projectionMatrixInverse.copy(this.camera.projectionMatrix).invert();
    this.isStale = true;
  }

  setTime(time) {
    document.getElementById("time").value = time;
    document.getElementById("moment").textContent = `${time.toFixed(2)} s`;
    if (time === this.time) return;
    this.time = time;
    const { means, velocities, times } = this.gaussians;
    // A splat of the library starts with its centre, three 32-bit floats.
    const centres = new Float32Array(this.splats.extArrays[0].buffer);
    for (const i of this.moving) {
      for (let k = 0; k < 3; k++) {
        centres[4 * i + k] = means[3 * i + k] + velocities[3 * i + k] * (time - times[i]);
      }
    }
    this.splats.textures.forEach((texture) => (texture.needsUpdate = true));
    this.mesh.updateVersion();
    this.isStale = true;
  }

  // One drawing after the other: the library would answer a second one while it sorts with the order of the first.
  draw() {
    this.drawing = (this.drawing ?? Promise.resolve()).then(() => this.drawNow());
    return this.drawing;
  }

  async drawNow() {
    this.isStale = false;
    this.camera.updateMatrixWorld();
    // The first update makes the splats of this moment and sorts them, the second takes the order that was found.
    await this.spark.update({ scene: this.world, camera: this.camera });
    await this.spark.update({ scene: this.world, camera: this.camera });
    this.renderer.render(this.world, this.camera);
  }

  async loop() {
    const now = performance.now();
    if (this.isPlaying) {
      const [first, last] = this.span;
      const next = this.time + (now - this.last) / 1000;
      this.setTime(next > last ? first : next);
    }
    this.last = now;
    if (this.isStale || this.isMoving || this.spark.dirty) await this.draw();
    requestAnimationFrame(() => this.loop());
  }
}

function splatsOf({ count, means, logScales, quats, opacities, colours }) {
  const packed = new ExtSplats({ maxSplats: Math.max(1, count) });
  const [centre, scales, quat, colour] = [
    new THREE.Vector3(),
    new THREE.Vector3(),
    new THREE.Quaternion(),
    new THREE.Color(),
  ];
  for (let i = 0; i < count; i++) {
    centre.fromArray(means, 3 * i);
    scales.fromArray(logScales, 3 * i).set(Math.exp(scales.x), Math.exp(scales.y), Math.exp(scales.z));
    quat.set(quats[4 * i + 1], quats[4 * i + 2], quats[4 * i + 3], quats[4 * i]).normalize();
    colour.setRGB(colours[3 * i], colours[3 * i + 1], colours[3 * i + 2], THREE.LinearSRGBColorSpace);
    packed.setSplat(i, centre, scales, quat, opacities[i], colour);
  }
  // Only splats that are made from whole arrays reach the graphics card.
  return new ExtSplats({ extArrays: packed.extArrays, numSplats: count });
}
