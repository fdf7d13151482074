"use strict";
// The page of `furrowmap live`: draws what the stream of events says, and sends nothing.
const WORDS = {
  en: {
    worked: "worked", rate: "rate", speed: "speed", fix: "GNSS", overlap: "overlap", missed: "missed", sigma: "± 95 %", age: "age",
    down: "TOOL DOWN", up: "TOOL UP", unknown: "TOOL ?", north: "N", day: "Day", night: "Night",
    fixed: "fixed", float: "float", single: "single", dgps: "DGPS", none: "none", ppp: "PPP", pps: "PPS", estimated: "estim.", manual: "manual", simulated: "simul.",
    starting: "Connecting …", cut: "No connection. What is shown is {age} s old.", stale: "What is shown is {age} s old.", waiting: "Waiting: {what}",
    "missing-positions": "no GNSS position: waiting for the receiver", "missing-heading": "heading unknown: drive some metres",
    "missing-direction": "forward is assumed: first metres", "missing-tilt": "tilt not seen: the vehicle is taken as level",
    "missing-implement": "no implement in the session: no ground worked", "missing-tool-learning": "tool not learned yet: lower and lift it some times",
    "missing-tool": "state of the tool not seen",
  },
  ja: {
    worked: "作業済み", rate: "能率", speed: "速度", fix: "GNSS", overlap: "重複", missed: "作業残し", sigma: "± 95 %", age: "表示の遅れ",
    down: "作業機 下", up: "作業機 上", unknown: "作業機 ?", north: "北", day: "昼", night: "夜",
    fixed: "Fix", float: "Float", single: "単独", dgps: "DGPS", none: "なし", ppp: "PPP", pps: "PPS", estimated: "推定", manual: "手動", simulated: "模擬",
    starting: "接続中 …", cut: "接続が切れました。表示は {age} 秒前のものです。", stale: "表示は {age} 秒前のものです。", waiting: "待機中: {what}",
    "missing-positions": "GNSS の測位なし: 受信機を待っています", "missing-heading": "方位不明: 数メートル走行してください",
    "missing-direction": "前進方向は仮定です(走り始め)", "missing-tilt": "傾きが見えません: 水平とみなします",
    "missing-implement": "セッションに作業機がないため、作業済みの範囲は出ません", "missing-tool-learning": "作業機を学習中: 数回上げ下げしてください",
    "missing-tool": "作業機の状態が見えません",
  },
};
const asked = document.documentElement.dataset.language || navigator.language || "en";
// Without a Japanese font all its letters are the same box: then English is more use.
function drawn(letter) {
  const pen = Object.assign(document.createElement("canvas"), { width: 24, height: 24 }).getContext("2d");
  pen.font = getComputedStyle(document.body).font;
  pen.fillText(letter, 2, 20);
  return pen.canvas.toDataURL();
}
const language = asked.startsWith("ja") && drawn("作") !== drawn("業") ? "ja" : "en";
const words = WORDS[language];
document.documentElement.lang = language;
const $ = (id) => document.getElementById(id);
for (const name of ["worked", "rate", "speed", "fix", "overlap", "missed", "sigma", "age"]) $("l-" + name).textContent = words[name];
$("tool").textContent = words.unknown;

// Cells: a canvas for each tile, drawn again only where cells changed.
const map = { origin: null, background: null, cell: 0.1, side: 64, tiles: new Map() };
let pose = null, poseAt = 0, heardAt = 0, triedAt = 0, waiting = words.starting, connected = false;
let metres = 30, northUp = false;
const dark = matchMedia("(prefers-color-scheme: dark)");
let night = (localStorage.getItem("furrowmap-night") ?? String(dark.matches)) === "true";

function colours() {
  const style = getComputedStyle(document.documentElement);
  return Object.fromEntries(["ground", "worked", "overlap", "missed", "vehicle", "ink", "line", "paper"].map((n) => [n, style.getPropertyValue("--" + n).trim()]));
}
let colour = colours();
function rgba(hex) {
  const full = hex.length === 4 ? hex.replace(/[0-9a-f]/gi, "$&$&") : hex;
  return [1, 3, 5].map((i) => parseInt(full.slice(i, i + 2), 16));
}
function setNight() {
  document.documentElement.toggleAttribute("data-night", night);
  $("night").textContent = night ? words.day : words.night;
  colour = colours();
  for (const tile of map.tiles.values()) tile.stale = true;
}
$("night").onclick = () => { night = !night; localStorage.setItem("furrowmap-night", String(night)); setNight(); };
$("north").textContent = words.north;
$("north").onclick = () => { northUp = !northUp; $("north").setAttribute("aria-pressed", String(northUp)); };
$("near").onclick = () => { metres = Math.max(8, metres / 1.5); };
$("far").onclick = () => { metres = Math.min(2000, metres * 1.5); };

function tileAt(x, y) {
  const key = x + "," + y;
  let tile = map.tiles.get(key);
  if (!tile) {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = map.side;
    tile = { x, y, state: new Uint8Array(map.side * map.side), canvas, stale: true };
    map.tiles.set(key, tile);
  }
  return tile;
}
function paint(tile) {
  const side = map.side, image = new ImageData(side, side);
  const of = [null, rgba(colour.worked), rgba(colour.overlap), rgba(colour.missed)];
  for (let row = 0; row < side; row++) {
    for (let column = 0; column < side; column++) {
      const rgb = of[tile.state[row * side + column]];
      if (!rgb) continue;
      const at = 4 * ((side - 1 - row) * side + column); // rows go north
      image.data[at] = rgb[0]; image.data[at + 1] = rgb[1]; image.data[at + 2] = rgb[2]; image.data[at + 3] = 255;
    }
  }
  tile.canvas.getContext("2d").putImageData(image, 0, 0);
  tile.stale = false;
}

async function takePicture(picture) {
  const bytes = Uint8Array.from(atob(picture.cells), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const cells = new Uint8Array(await new Response(stream).arrayBuffer());
  takePlace(picture);
  map.cell = picture.cell_m; map.side = picture.tile;
  map.tiles.clear();
  const size = map.side * map.side;
  picture.tiles.forEach(([x, y], i) => tileAt(x, y).state.set(cells.subarray(i * size, (i + 1) * size)));
}
function takePlace(place) {
  map.origin = place.origin_m || null;
  map.background = place.background || null;
  $("source").textContent = map.background ? map.background.attribution : "";
}
function takeCells(tiles) {
  for (const [x, y, runs] of tiles) {
    const tile = tileAt(x, y);
    for (let i = 0; i < runs.length; i += 3) tile.state.fill(runs[i + 2], runs[i], runs[i] + runs[i + 1]);
    tile.stale = true;
  }
}

// The background: images of the tiles around, and those of two zooms less until they are here.
const images = new Map();
function imageOf(path) {
  let image = images.get(path);
  if (!image) {
    image = new Image();
    image.src = path;
    images.set(path, image);
    if (images.size > 300) images.delete(images.keys().next().value);
  }
  return image.complete && image.naturalWidth ? image : null;
}
function drawBackground(east, north, reach, pixelsPerMetre) {
  const { at, en_m: [e0, n0], to_m: [[a, b], [c, d]], zooms } = map.background;
  const unit = Math.hypot(a, c), det = a * d - b * c, de = east - e0, dn = north - n0;
  const x = at[0] + (d * de - b * dn) / det, y = at[1] + (a * dn - c * de) / det;
  const best = Math.min(zooms[1], Math.max(zooms[0], Math.round(Math.log2(unit * pixelsPerMetre / 256))));
  pen.save();
  pen.imageSmoothingEnabled = true;
  pen.globalAlpha = night ? 0.35 : 0.8;
  for (const zoom of new Set([Math.max(zooms[0], best - 2), best])) {
    const count = 2 ** zoom, around = reach / unit * count;
    if (around > 8) continue;  // a map of small tiles only, seen from far
    for (let row = Math.max(0, Math.floor(y * count - around)); row <= Math.min(count - 1, y * count + around); row++) {
      for (let column = Math.floor(x * count - around); column <= x * count + around; column++) {
        const image = imageOf(`tiles/${zoom}/${(column % count + count) % count}/${row}`); // the world goes on at 180°
        if (!image) continue;
        const dx = column / count - at[0], dy = row / count - at[1];
        pen.save();
        pen.transform(a / count, -c / count, b / count, -d / count, a * dx + b * dy - de, dn - c * dx - d * dy);
        pen.drawImage(image, 0, 0, 1.003, 1.003);
        pen.restore();
      }
    }
  }
  pen.restore();
}

// Events are taken in their order, the picture included, which is unpacked asynchronously.
let order = Promise.resolve();
let source = null;
function connect() {
  if (source) source.close();
  triedAt = performance.now();
  source = new EventSource("events");
  source.onopen = () => { heardAt = performance.now(); connected = true; };
  const on = (name, take) => source.addEventListener(name, (e) => {
    heardAt = performance.now(); connected = true;
    const content = JSON.parse(e.data);
    order = order.then(() => take(content)).catch((error) => console.error(error));
  });
  on("alive", () => {});
  on("picture", takePicture);
  on("place", takePlace);
  on("cells", takeCells);
  on("pose", (p) => {
    waiting = "";
    if (p.e_m !== undefined) { pose = p; poseAt = heardAt; }
    const state = p.tool;
    $("tool").dataset.state = state; $("tool").textContent = words[state];
    $("missing").replaceChildren(...p.missing.map((code) => Object.assign(document.createElement("li"), { textContent: words["missing-" + code] || code })));
    if (p.e_m === undefined) return;
    $("speed").innerHTML = number(3.6 * p.speed_mps, 1) + " <small>km/h</small>";
    $("fix").textContent = p.position_age_s > 1 ? number(p.position_age_s, 0) + " s" : words[p.fix] || p.fix;
    const off_m = 1.73 * p.sigma_m;  // 95 % of the positions lie this near, with errors alike in both directions
    $("sigma").innerHTML = (off_m < 1 ? number(100 * off_m, 0) + " <small>cm</small>" : number(off_m, 1) + " <small>m</small>");
  });
  on("figures", (f) => {
    $("worked").innerHTML = hectares(f.worked_m2);
    $("overlap").innerHTML = hectares(f.overlap_m2);
    $("missed").innerHTML = hectares(f.missed_m2);
    $("rate").innerHTML = f.rate_m2ps === null ? "–" : number(f.rate_m2ps * 0.36, 2) + " <small>ha/h</small>";
    warnings = f.warnings.map((warning) => warning[language]);
  });
  on("waiting", (what) => { waiting = words.waiting.replace("{what}", what[language]); });
  source.onerror = () => { connected = false; };
}
let warnings = [];
const number = (value, digits) => value.toLocaleString(language, { minimumFractionDigits: digits, maximumFractionDigits: digits });
const hectares = (m2) => (m2 < 1000 ? number(m2, 0) + " <small>m²</small>" : number(m2 / 1e4, 2) + " <small>ha</small>");

const canvas = $("map"), pen = canvas.getContext("2d");
function draw() {
  requestAnimationFrame(draw);
  const ratio = window.devicePixelRatio || 1, width = canvas.clientWidth, height = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
    canvas.width = Math.round(width * ratio); canvas.height = Math.round(height * ratio);
  }
  pen.setTransform(ratio, 0, 0, ratio, 0, 0);
  pen.fillStyle = colour.ground; pen.fillRect(0, 0, width, height);
  const now = performance.now(), age = pose ? pose.delay_s + (now - poseAt) / 1000 : 0;
  say(age, now);
  if (!pose || !map.origin) return;
  // Between two messages the vehicle goes on as it went; for half a second, not more.
  const ahead = connected ? Math.min(0.5, (now - poseAt) / 1000) : 0;
  const heading = (pose.heading_deg + pose.turn_degps * ahead) * Math.PI / 180;
  const east = pose.e_m + Math.sin(heading) * pose.speed_mps * ahead, north = pose.n_m + Math.cos(heading) * pose.speed_mps * ahead;
  const scale = Math.min(width, height) / metres;
  pen.save();
  pen.translate(width / 2, height * (northUp ? 0.5 : 0.62));
  if (!northUp) pen.rotate(-heading);
  pen.scale(scale, scale);
  const side = map.cell * map.side, reach = 0.75 * Math.hypot(width, height) / scale + side;
  if (map.background) drawBackground(east, north, reach, scale * ratio);
  pen.imageSmoothingEnabled = false;
  for (const tile of map.tiles.values()) {
    const x = tile.x * side - east, y = tile.y * side - north;
    if (Math.hypot(x, y) > reach) continue;
    if (tile.stale) paint(tile);
    pen.drawImage(tile.canvas, x, -y - side, side * 1.002, side * 1.002);
  }
  pen.rotate(heading);
  pen.beginPath();
  const size = Math.max(1.4, 18 / scale);
  pen.moveTo(0, -1.3 * size); pen.lineTo(0.8 * size, 0.8 * size); pen.lineTo(0, 0.4 * size); pen.lineTo(-0.8 * size, 0.8 * size); pen.closePath();
  pen.fillStyle = colour.vehicle; pen.strokeStyle = colour.paper; pen.lineWidth = 3 / scale; pen.fill(); pen.stroke();
  pen.restore();
  bar(width, height, scale);
}
function bar(width, height, scale) {
  const length = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000].find((m) => m * scale > 60) || 1000;
  const y = height - 64, right = width - 12;
  pen.strokeStyle = pen.fillStyle = colour.ink; pen.lineWidth = 3;
  pen.beginPath(); pen.moveTo(right - length * scale, y); pen.lineTo(right, y); pen.stroke();
  pen.font = "600 15px system-ui, sans-serif"; pen.textAlign = "right"; pen.fillText(length + " m", right, y + 18);
}
let saidAt = 0;
function say(age, now) {
  if (now - saidAt < 200) return;
  saidAt = now;
  const silent = (now - heardAt) / 1000;
  $("age").innerHTML = pose ? number(age, 1) + " <small>s</small>" : "–";
  const seconds = number(Math.round(pose ? age : silent), 0);
  let text = waiting;
  // A link that is cut may leave the connection open for minutes, so that no error comes: then it is made anew.
  if (silent > 5 || !connected) { if (now - triedAt > 2000) connect(); }
  if (heardAt && (!connected || silent > 5)) text = words.cut.replace("{age}", seconds);
  else if (!text && pose && age > 2) text = words.stale.replace("{age}", seconds);
  else if (!text && warnings.length) text = warnings[0];
  $("alarm").textContent = text; $("alarm").hidden = !text;
}
setNight();
connect();
draw();
// Keeps the screen awake where the browser allows it: only for https and localhost.
if (navigator.wakeLock) {
  const awake = () => { if (document.visibilityState === "visible") navigator.wakeLock.request("screen").catch(() => {}); };
  document.addEventListener("visibilitychange", awake);
  awake();
}
