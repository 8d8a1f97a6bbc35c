// The robot on its floor. Coordinates are those of `map`: x forward, y left, z up [m].

import * as THREE from 'three';
import { OrbitControls } from './three/OrbitControls.js';

const COLOURS = {
  light: { sky: 0xe9eef4, floor: '#efece5', line: '#cfcabd', ghost: 0x7887dc },
  dark: { sky: 0x15181c, floor: '#2a2e34', line: '#434a53', ghost: 0x8f9cf0 },
};
const WALL = 0x949eaa;
const FORCE = 0x2c74be;
const TILE_M = 0.5;
const FLOOR_M = 60;
const START = [-0.6, -0.78, 0.36];
const LOOK_AT_M = 0.17;

export const NEWTONS_PER_METRE = 10;
const MAX_FORCE = 3;
const MIN_FORCE = 0.1;

/**
 * The scene. While somebody drags the robot, `aim` is called with the size of the force [N], at the
 * end with 0; after that `push` with the force in plane signs, if there is one.
 */
export class Scene {
  #canvas;
  #renderer;
  #scene = new THREE.Scene();
  #camera = new THREE.PerspectiveCamera(40, 1, 0.02, 100);
  #controls;
  #dark = matchMedia('(prefers-color-scheme: dark)');
  #floor = new THREE.Mesh(new THREE.PlaneGeometry(FLOOR_M, FLOOR_M));
  #sun = new THREE.DirectionalLight(0xffffff, 2.2);
  #map = new THREE.Group();
  #arrow = new THREE.ArrowHelper(new THREE.Vector3(1, 0, 0), new THREE.Vector3(), 1, FORCE);
  #robot;
  #ghost;
  #grip;

  constructor(canvas, shape, { aim, push }) {
    this.#canvas = canvas;
    this.#renderer = new THREE.WebGLRenderer({ canvas, antialias: true });
    this.#renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    this.#renderer.shadowMap.enabled = true;
    this.#camera.up.set(0, 0, 1);
    this.#camera.position.set(...START);
    this.#controls = new OrbitControls(this.#camera, canvas);
    this.#controls.target.set(0, 0, LOOK_AT_M);
    this.#controls.minDistance = 0.3;
    this.#controls.maxDistance = 8;
    this.#controls.maxPolarAngle = 0.49 * Math.PI;
    this.#controls.enablePan = false;
    this.#robot = new Robot(shape);
    this.#ghost = new Robot(shape, COLOURS.light.ghost);
    this.#ghost.visible = false;
    this.#arrow.visible = false;
    // The arrow starts inside the body, which must not hide it.
    for (const part of [this.#arrow.line, this.#arrow.cone]) Object.assign(part, { renderOrder: 1 }).material.depthTest = false;
    this.#sun.castShadow = true;
    this.#sun.shadow.mapSize.set(1024, 1024);
    for (const side of ['left', 'bottom']) this.#sun.shadow.camera[side] = -0.6;
    for (const side of ['right', 'top']) this.#sun.shadow.camera[side] = 0.6;
    this.#floor.receiveShadow = true;
    this.#scene.add(
      this.#floor, this.#map, this.#robot, this.#ghost, this.#arrow, this.#sun, this.#sun.target,
      new THREE.HemisphereLight(0xffffff, 0xb5b0a4, 1.9),
    );
    this.#dark.onchange = () => this.#colour();
    this.#colour();
    this.#grip = shape.gripHeight;
    this.#takeDrags(aim, push);
    new ResizeObserver(() => this.#resize()).observe(canvas.parentElement);
    this.#resize();
  }

  #colour() {
    const colours = this.#dark.matches ? COLOURS.dark : COLOURS.light;
    this.#scene.background = new THREE.Color(colours.sky);
    this.#scene.fog = new THREE.Fog(colours.sky, 3, 14);
    this.#floor.material = new THREE.MeshStandardMaterial({ map: tiles(colours), roughness: 1 });
    this.#ghost.colour(colours.ghost);
  }

  #resize() {
    const { clientWidth, clientHeight } = this.#canvas.parentElement;
    if (!clientWidth || !clientHeight) return;
    this.#renderer.setSize(clientWidth, clientHeight, false);
    this.#camera.aspect = clientWidth / clientHeight;
    this.#camera.updateProjectionMatrix();
  }

  /** Show the map at an address, with its walls, or an unlimited floor. */
  showMap(map, address) {
    this.#map.clear();
    this.#floor.visible = !map;
    if (!map) return;
    const texture = new THREE.TextureLoader().load(address);
    texture.colorSpace = THREE.SRGBColorSpace;
    texture.magFilter = THREE.NearestFilter;
    const ground = new THREE.Mesh(
      new THREE.PlaneGeometry(...map.size),
      new THREE.MeshStandardMaterial({ map: texture, roughness: 1 }),
    );
    ground.receiveShadow = true;
    this.#map.add(ground);
    const material = new THREE.MeshStandardMaterial({ color: WALL });
    for (const [left, bottom, right, top] of map.walls) {
      const wall = new THREE.Mesh(new THREE.BoxGeometry(right - left, top - bottom, map.height), material);
      wall.position.set((left + right) / 2, (bottom + top) / 2, map.height / 2);
      this.#map.add(wall);
    }
  }

  /** Show the robot, and the ghost if there is one, each with x, y, pitchX, pitchY in plane signs. */
  show(robot, ghost) {
    const before = this.#robot.position.clone();
    this.#robot.place(robot);
    const moved = this.#robot.position.clone().sub(before);
    this.#camera.position.add(moved);
    this.#controls.target.add(moved);
    this.#ghost.visible = Boolean(ghost);
    if (ghost) this.#ghost.place(ghost);
    const { x, y } = this.#robot.position;
    this.#sun.position.set(x - 0.8, y + 0.6, 1.8);
    this.#sun.target.position.set(x, y, 0);
    // The tiles stay where they are, however far the robot goes.
    this.#floor.position.set(TILE_M * Math.round(x / TILE_M), TILE_M * Math.round(y / TILE_M), 0);
    this.#controls.update();
    this.#renderer.render(this.#scene, this.#camera);
  }

  /** Where the robot is on the screen, in pixels of the page. */
  robotOnScreen() {
    const { x, y } = this.#robot.position;
    const point = new THREE.Vector3(x, y, this.#grip).project(this.#camera);
    const { left, top, width, height } = this.#canvas.getBoundingClientRect();
    return [left + ((point.x + 1) / 2) * width, top + ((1 - point.y) / 2) * height];
  }

  #takeDrags(aim, push) {
    let start = null; // where the drag began
    let force = [0, 0];
    this.#canvas.addEventListener('pointerdown', (event) => {
      if (!event.isPrimary || event.button || !this.#isOnRobot(event)) return;
      start = event;
      force = [0, 0];
      this.#controls.enabled = false;
      this.#canvas.setPointerCapture(event.pointerId);
    }, { capture: true });
    this.#canvas.addEventListener('pointermove', (event) => {
      if (start) {
        force = this.#force(event.clientX - start.clientX, event.clientY - start.clientY);
        aim(Math.hypot(...force));
      } else this.#canvas.style.cursor = this.#isOnRobot(event) ? 'grab' : '';
    });
    const release = ({ type }) => {
      if (!start) return;
      this.#controls.enabled = true;
      this.#arrow.visible = false;
      aim(0);
      if (type === 'pointerup' && Math.hypot(...force) >= MIN_FORCE) push(force[0], -force[1]);
      start = null;
    };
    for (const type of ['pointerup', 'pointercancel']) this.#canvas.addEventListener(type, release);
  }

  #isOnRobot({ clientX, clientY }) {
    const { left, top, width, height } = this.#canvas.getBoundingClientRect();
    const caster = new THREE.Raycaster();
    const point = new THREE.Vector2((2 * (clientX - left)) / width - 1, 1 - (2 * (clientY - top)) / height);
    caster.setFromCamera(point, this.#camera);
    return caster.intersectObject(this.#robot.hull).length > 0;
  }

  /** Return the force of a drag by pixels, x and y in `map` [N], and show its arrow. */
  #force(right, down) {
    const { x, y } = this.#robot.position;
    const grip = new THREE.Vector3(x, y, this.#grip);
    const distance = this.#camera.position.distanceTo(grip);
    const metresPerPixel = (2 * distance * Math.tan((this.#camera.fov * Math.PI) / 360)) / this.#canvas.clientHeight;
    const ahead = this.#camera.getWorldDirection(new THREE.Vector3()).setZ(0).normalize();
    const pull = new THREE.Vector3(ahead.y * right - ahead.x * down, -ahead.x * right - ahead.y * down, 0)
      .multiplyScalar(metresPerPixel).clampLength(0, MAX_FORCE / NEWTONS_PER_METRE);
    const length = pull.length();
    this.#arrow.visible = length > 0.005;
    this.#arrow.position.copy(grip);
    this.#arrow.setDirection(pull.clone().normalize());
    this.#arrow.setLength(length, Math.min(0.05, 0.5 * length), 0.03);
    return [NEWTONS_PER_METRE * pull.x, NEWTONS_PER_METRE * pull.y];
  }
}

/** Return a texture of tiles, one of which has its middle in the origin. */
function tiles({ floor, line }) {
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = 128;
  const context = canvas.getContext('2d');
  context.fillStyle = floor;
  context.fillRect(0, 0, 128, 128);
  context.strokeStyle = line;
  context.lineWidth = 3;
  context.strokeRect(0, 0, 128, 128);
  const texture = new THREE.CanvasTexture(canvas);
  texture.wrapS = texture.wrapT = THREE.RepeatWrapping;
  texture.repeat.set(FLOOR_M / TILE_M, FLOOR_M / TILE_M);
  texture.anisotropy = 8;
  texture.colorSpace = THREE.SRGBColorSpace;
  return texture;
}

/** A robot with the parts of `shape`; `ghost` is the colour of one that only shows what was. */
class Robot extends THREE.Group {
  #shape;
  #body = new THREE.Group();
  #ball = new THREE.Group();
  #wheels;
  #material = null;
  hull = new THREE.Mesh(); // what can be grasped, also between the parts

  constructor(shape, ghost) {
    super();
    this.#shape = shape;
    if (ghost !== undefined) {
      this.#material = new THREE.MeshStandardMaterial({ color: ghost, transparent: true, opacity: 0.35, depthWrite: false });
    }
    this.#wheels = shape.wheels.map((centre) => {
      const wheel = new THREE.Group();
      wheel.position.set(...centre);
      return wheel;
    });
    const links = { base_link: this.#body, wheel_x: this.#wheels[0], wheel_y: this.#wheels[1] };
    for (const part of shape.parts.filter(({ link }) => link in links)) links[part.link].add(this.#part(part));
    for (const sector of this.#sectors()) this.#ball.add(sector);
    this.#body.add(...this.#wheels);
    for (const each of [this.#body, this.#ball]) each.position.z = shape.ballRadius;
    this.add(this.#body, this.#ball);
    const box = new THREE.Box3().setFromObject(this.#body);
    this.hull.geometry = new THREE.BoxGeometry(...box.getSize(new THREE.Vector3()).toArray());
    this.hull.position.copy(box.getCenter(new THREE.Vector3())).sub(this.#body.position);
    this.hull.visible = false;
    this.#body.add(this.hull);
  }

  colour(colour) {
    this.#material.color.set(colour);
  }

  #mesh(geometry, [red, green, blue]) {
    const colour = new THREE.Color(`rgb(${red}, ${green}, ${blue})`);
    const mesh = new THREE.Mesh(geometry, this.#material ?? new THREE.MeshStandardMaterial({ color: colour, roughness: 0.6 }));
    mesh.castShadow = !this.#material;
    return mesh;
  }

  #part({ shape, size, position, rpy, colour }) {
    const mesh = this.#mesh(
      shape === 'box' ? new THREE.BoxGeometry(...size)
        : shape === 'sphere' ? new THREE.SphereGeometry(size[0], 32, 24)
        // Along z instead of y.
        : new THREE.CylinderGeometry(size[0], size[0], size[1], 32).rotateX(Math.PI / 2),
      colour,
    );
    mesh.position.set(...position);
    mesh.rotation.set(...rpy, 'ZYX');
    return mesh;
  }

  /** Return the eighths of the ball, whose colours make its rolling visible. */
  #sectors() {
    const { colour } = this.#shape.parts.find(({ link }) => link === 'ball');
    return [0, 1, 2, 3, 4, 5, 6, 7].map((number) => {
      const [quarter, half] = [number % 4, number >> 2];
      const right = Math.PI / 2;
      const geometry = new THREE.SphereGeometry(
        this.#shape.ballRadius, 12, 12, quarter * right, right, half * right, right,
      );
      return this.#mesh(geometry, (quarter + half) % 2 ? colour : [246, 247, 248]);
    });
  }

  /** Place the robot; the ball rolls from where it was. */
  place({ x, y, pitchX, pitchY }) {
    const { ballRadius, wheelRadius } = this.#shape;
    const turn = new THREE.Vector3(y + this.position.y, x - this.position.x, 0).divideScalar(ballRadius);
    const angle = turn.length();
    if (angle) this.#ball.quaternion.premultiply(new THREE.Quaternion().setFromAxisAngle(turn.normalize(), angle));
    this.position.set(x, -y, 0);
    const [sinX, cosX] = [Math.sin(pitchX / 2), Math.cos(pitchX / 2)];
    const [sinY, cosY] = [Math.sin(pitchY / 2), Math.cos(pitchY / 2)];
    // Roll, then pitch, no yaw, as in the message plant/imu.
    this.#body.quaternion.set(cosX * sinY, sinX * cosY, -sinX * sinY, cosX * cosY);
    const ratio = ballRadius / wheelRadius;
    this.#wheels[0].rotation.y = -ratio * (x / ballRadius - pitchX);
    this.#wheels[1].rotation.x = -ratio * (y / ballRadius - pitchY);
  }
}
