// The cloud of a shared result in three dimensions. Its points come from points.js, read when they are asked for.
import {
  BufferAttribute, BufferGeometry, Color, ColorManagement, LinearSRGBColorSpace, PerspectiveCamera, Points,
  PointsMaterial, Scene, Sphere, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";

const STEPS = 65535;
const POINT_PIXELS = 2;
const UNSEEN = [96, 104, 110]; // of no image
const HEIGHT_RAMP = ["#440154", "#3b528b", "#21918c", "#5ec962", "#fde725"];

function bytes(base64) {
  const text = atob(base64);
  const out = new Uint8Array(text.length);
  for (let i = 0; i < text.length; i++) out[i] = text.charCodeAt(i);
  return out;
}

function rgb(colour) {
  const value = parseInt(colour.slice(1), 16);
  return [value >> 16, (value >> 8) & 255, value & 255];
}

/** 256 colours from the lowest to the highest. */
function ramp() {
  const stops = HEIGHT_RAMP.map(rgb);
  return Array.from({ length: 256 }, (_, i) => {
    const at = (i / 255) * (stops.length - 1);
    const k = Math.min(Math.floor(at), stops.length - 2);
    return stops[k].map((from, c) => Math.round(from + (at - k) * (stops[k + 1][c] - from)));
  });
}

export function show(canvas, cloud, extent) {
  ColorManagement.enabled = false;
  const renderer = new WebGLRenderer({ canvas, antialias: false });
  renderer.outputColorSpace = LinearSRGBColorSpace;
  const positions = new Uint16Array(bytes(cloud.xyz).buffer);
  const classes = bytes(cloud.classes);
  const photo = cloud.rgb ? bytes(cloud.rgb) : null;
  const size = cloud.high.map((value, axis) => value - cloud.low[axis]);
  // Coordinates of the scene begin at the corner of the cloud: single precision has no room for those of the map.
  const geometry = new BufferGeometry();
  geometry.setAttribute("position", new BufferAttribute(positions, 3));
  geometry.boundingSphere = new Sphere(new Vector3(STEPS / 2, STEPS / 2, STEPS / 2), STEPS);
  const colours = new Uint8Array(3 * classes.length);
  geometry.setAttribute("color", new BufferAttribute(colours, 3, true));
  const material = new PointsMaterial({ size: POINT_PIXELS, sizeAttenuation: false, vertexColors: true });
  const points = new Points(geometry, material);
  points.scale.set(...size.map((length) => length / STEPS));
  points.frustumCulled = false;
  const scene = new Scene();
  scene.background = new Color("#20262a");
  scene.add(points);
  const camera = new PerspectiveCamera(50, 1, 0.1, 5000);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, canvas);
  controls.screenSpacePanning = false;
  controls.maxPolarAngle = Math.PI * 0.55;

  let waiting = false;
  function draw() {
    if (waiting) return;
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      renderer.render(scene, camera);
    });
  }
  controls.addEventListener("change", draw);
  let moved = false;
  controls.addEventListener("start", () => { moved = true; });

  function whole() {
    moved = false;
    const [west, south, east, north] = extent;
    const middle = [(west + east) / 2 - cloud.low[0], (south + north) / 2 - cloud.low[1], cloud.ground - cloud.low[2]];
    const reach = Math.max(east - west, north - south, 5);
    const target = new Vector3(...middle);
    const back = new Vector3(-0.5, -0.9, 0.7).normalize();
    const right = new Vector3().crossVectors(camera.up, back).normalize();
    const above = new Vector3().crossVectors(back, right);
    // The nearest place from which every corner lies in the picture, whatever its sides.
    const slope = Math.tan((camera.fov * Math.PI) / 360);
    let away = 0;
    for (const x of [west, east])
      for (const y of [south, north])
        for (const z of cloud.heights) {
          const corner = new Vector3(x, y, z).sub(new Vector3(...cloud.low)).sub(target);
          const aside = Math.abs(corner.dot(right)) / camera.aspect;
          away = Math.max(away, Math.max(aside, Math.abs(corner.dot(above))) / slope + corner.dot(back));
        }
    controls.target.copy(target);
    camera.position.copy(target).addScaledVector(back, away);
    camera.near = reach / 1000;
    camera.far = 20 * Math.max(reach, ...size);
    camera.updateProjectionMatrix();
    controls.update();
    draw();
  }

  function resize() {
    const { clientWidth, clientHeight } = canvas.parentElement;
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(clientWidth, clientHeight, false);
    if (!clientWidth || !clientHeight) return;
    camera.aspect = clientWidth / clientHeight;
    camera.updateProjectionMatrix();
    if (moved) draw();
    else whole();
  }

  // The machine itself would cover the ground with a trace of itself.
  const hidden = new Set(cloud.hidden);
  function choosePoints() {
    const chosen = new Uint32Array(classes.length);
    let n = 0;
    for (let i = 0; i < classes.length; i++) if (!hidden.has(classes[i])) chosen[n++] = i;
    geometry.setIndex(new BufferAttribute(chosen.subarray(0, n), 1));
    draw();
  }
  choosePoints();

  function showClass(code, shown) {
    if (shown) hidden.delete(code);
    else hidden.add(code);
    choosePoints();
  }

  const colourings = [...(photo ? ["Photo"] : []), "Height", "Class"];
  let colouring = colourings[0];
  const palette = Object.fromEntries(cloud.palette.map(({ code, colour }) => [code, rgb(colour)]));
  const heights = ramp();
  const [lowest, highest] = cloud.heights;

  function colour(name) {
    colouring = name;
    for (let i = 0; i < classes.length; i++) {
      let at;
      if (name === "Photo") {
        at = photo.subarray(3 * i, 3 * i + 3);
        if (!at[0] && !at[1] && !at[2]) at = UNSEEN;
      } else if (name === "Class") at = palette[classes[i]] ?? [200, 200, 200];
      else {
        const z = cloud.low[2] + (positions[3 * i + 2] / STEPS) * size[2];
        const share = (z - lowest) / Math.max(highest - lowest, 0.01);
        at = heights[Math.round(255 * Math.min(Math.max(share, 0), 1))];
      }
      colours.set(at, 3 * i);
    }
    geometry.attributes.color.needsUpdate = true;
    draw();
  }

  function legend() {
    if (colouring === "Class") return cloud.palette.map(({ colour, label }) => ({ colour, label }));
    if (colouring === "Photo") return [];
    const at = (i) => lowest + (i / (HEIGHT_RAMP.length - 1)) * (highest - lowest);
    return HEIGHT_RAMP.map((colour, i) => ({ colour, label: `${at(i).toFixed(2)} m` }));
  }

  colour(colouring);
  resize();
  return {
    colourings, colouring: () => colouring, colour, legend, resize, whole, showClass,
    classes: () => cloud.palette.map((one) => ({ ...one, shown: !hidden.has(one.code) })),
  };
}
